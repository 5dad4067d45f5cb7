"""A person of a world as truth, model files made from the embedded body, and miniatures of
results.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from physic_bench.bodies import BodyFiles
from physic_bench.scoring import LIMB_JOINTS
from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX
from physic_core.cli import main
from physic_testing.worlds import load_world

ROOT = Path(__file__).parents[3]
NAMES = ("jump", "stand", "walk")
TRUE = {
    name: load_world(name).joints[0][[JOINT_INDEX[joint] for joint in LIMB_JOINTS]].astype(float)
    for name in NAMES
}
"""Limb joints (12, 3) m of the person of three worlds."""
STANDING = {"global_orient": [np.pi, 0, 0], "transl": [0.1, 0.35, 3.5]}
"""Upright before an OpenCV camera, facing it."""


def other_body():
    """The module of the core's tests that makes bodies of SMPL-X's and SMPL's kind from the
    embedded one.
    """
    if "other_body" not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            "other_body", ROOT / "tests" / "body" / "other_body.py"
        )
        assert spec is not None
        assert spec.loader is not None
        sys.modules["other_body"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["other_body"])
    return sys.modules["other_body"]


@dataclass(frozen=True)
class Files:
    """Model files, and their bodies posed."""

    bodies: BodyFiles

    @property
    def faces(self):
        return load_body(str(self.bodies.file("smplx", "male"))).faces.numpy()

    def arguments(self):
        return ["--smplx", str(self.bodies.smplx), "--smpl", str(self.bodies.smpl)]


def write_models(folder):
    """Write files of the size and layout of SMPLX_{NEUTRAL,MALE}.npz and SMPL_NEUTRAL.pkl; male is
    the larger.
    """
    from physic_core.body import load_body
    from physic_testing.body_files import write_published

    body = other_body()
    embedded = load_body("embedded")
    for name in ("smplx", "smpl"):
        (folder / name).mkdir()
    arrays = body.smplx_file_arrays(body.make(embedded, 10475))
    rng = np.random.default_rng(0)
    for side in "lr":
        arrays[f"hands_mean{side}"] = 0.1 * np.ones(45)
        arrays[f"hands_components{side}"] = np.linalg.qr(rng.standard_normal((45, 45)))[0]
    np.savez(folder / "smplx" / "SMPLX_NEUTRAL.npz", **arrays)
    np.savez(
        folder / "smplx" / "SMPLX_MALE.npz", **arrays | {"v_template": 1.05 * arrays["v_template"]}
    )
    write_published(
        folder / "smpl" / "SMPL_NEUTRAL.pkl", body.smpl_file_arrays(body.make(embedded, 6890))
    )
    return Files(BodyFiles(folder / "smplx", folder / "smpl"))


def run(*arguments):
    """Run ``physic evaluate`` with these arguments."""
    return CliRunner().invoke(main, ["evaluate", *arguments])


def write_plain(folder, name, **arrays):
    """Write a result of the plain reader."""
    path = folder / f"{name}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)


def write_results(root, frames=NAMES, *, name="theirs", move=lambda points: points, **more):
    """Write results of three worlds beside the folder of their photos, and return their
    argument.
    """
    for frame in frames:
        joints = move(TRUE[frame])[None]
        names = np.array(LIMB_JOINTS)
        write_plain(root.parent / name, frame, joints=joints, joint_names=names, **more)
    return f"{name}=plain:{root.parent / name}"


def evaluated(root, *theirs, fails=False):
    """Evaluate results of three worlds, and return the figures of the last, or the error."""
    (root.parent / "three.txt").write_text("\n".join(NAMES))
    more = [part for one in theirs for part in ("--results", one)]
    arguments = ("worlds", str(root), "-o", str(root.parent / "out"), *more)
    done = run(*arguments, "--frames", str(root.parent / "three.txt"))
    assert (done.exit_code != 0) == fails, done.output
    if fails:
        return done.output.partition("Error: ")[2].strip()
    return figures(root.parent / "out", theirs[-1].partition("=")[0])


def figures(out, method):
    """Column -> value of a method in results.json."""
    document = json.loads((out / "results.json").read_text())
    return {
        key: value["value"] for key, value in document["figures"][method].items() if value["count"]
    }


def python2_pickle(path, values):
    """Write a pickle as Python 2 with numpy 1 wrote it: texts and bytes are both "str"."""
    import io
    import pickle
    import struct

    class Python2(pickle._Pickler):
        def save_text(self, value):
            data = value if isinstance(value, bytes) else value.encode("latin1")
            self.write(pickle.BINSTRING + struct.pack("<i", len(data)) + data)
            self.memoize(value)

        dispatch: ClassVar[dict[Any, Any]] = {
            **pickle._Pickler.dispatch,
            str: save_text,
            bytes: save_text,
        }

    stream = io.BytesIO()
    Python2(stream, protocol=2).dump(values)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(stream.getvalue().replace(b"cnumpy._core.", b"cnumpy.core."))


def ring(contact, faces):
    """Contact (V,) and all neighbours of its vertices: moved outward by one ring."""
    grown = contact.copy()
    grown[faces[contact[faces].any(1)]] = True
    return grown


def rotation(axis, degrees):
    """(3, 3) about x, y or z."""
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def rigid(R, t):
    """(4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = R
    matrix[:3, 3] = t
    return matrix


def moved_by(matrix, points):
    """Points (n, 3) after a rigid transform."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def moved_parameters(files, matrix, parameters, gender):
    """Parameters of the same body after a rigid transform."""
    pelvis = files.bodies.pose_smplx({**parameters, "transl": np.zeros(3)}, gender)[1][0]
    turned = Rotation.from_matrix(matrix[:3, :3]) * Rotation.from_rotvec(
        parameters["global_orient"]
    )
    transl = moved_by(matrix, parameters["transl"] + pelvis) - pelvis
    return {**parameters, "global_orient": turned.as_rotvec(), "transl": transl}
