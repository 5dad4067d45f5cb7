"""Bodies for the tests: the embedded one, and made-up SMPL-X files in both layouts."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from physic_core.body import JOINT_INDEX, JOINT_NAMES, load_body
from physic_core.body.model import BodyArrays, build_body_model
from physic_core.geometry.rotations import rotvec_to_rotmat_numpy
from physic_core.geometry.rotvecs import rotvec_to_rotmat

sys.path.append(str(Path(__file__).parent))  # other_body.py, which tests of this folder share

from other_body import make, smplx_file_arrays

NUM_VERTICES = 10475


@pytest.fixture(scope="session")
def embedded():
    """The embedded body, float32."""
    return load_body("embedded")


@pytest.fixture(scope="session")
def embedded64(embedded):
    """The embedded body, float64."""
    return embedded.to(dtype=torch.float64)


@pytest.fixture
def random_pose(embedded):
    """Three bodies far from rest: rotations, betas, transl."""
    draws = torch.randn(3, 168 + embedded.num_betas, generator=torch.Generator().manual_seed(7))
    turns, transl, betas = draws.split([165, 3, embedded.num_betas], 1)
    rotations = rotvec_to_rotmat(0.4 * turns.view(3, 55, 3))
    return {"rotations": rotations, "betas": betas, "transl": 3 * transl}


@pytest.fixture(scope="session")
def smplx_arrays(other):
    """The arrays of a made-up SMPL-X file, v1.1, with all that such a file holds."""
    rng = np.random.default_rng(0)

    def directions(size, columns):
        draws = rng.standard_normal((NUM_VERTICES, 3, columns), dtype=np.float32)
        return (size * draws).astype(np.float16)

    return smplx_file_arrays(other) | {
        "shapedirs": directions(0.004, 400),
        "posedirs": directions(2e-4, 486),
        "hands_meanl": rng.normal(0, 0.1, 45),
        "hands_meanr": rng.normal(0, 0.1, 45),
        "joint2num": np.array({name: i for i, name in enumerate(JOINT_NAMES)}, dtype=object),
    }


def _write(folder, arrays):
    path = folder / "SMPLX_NEUTRAL.npz"
    np.savez(path, **arrays)
    np.save(folder / "kid_template.npy", np.zeros((NUM_VERTICES, 3)))  # smplfitter wants one
    return path


@pytest.fixture(scope="session")
def smplx_v11(smplx_arrays, tmp_path_factory):
    """A made-up file in the v1.1 layout: 300 shape and 100 expression columns."""
    path = _write(tmp_path_factory.mktemp("smplx_v11"), smplx_arrays)
    yield path
    path.unlink()  # pytest keeps folders of old runs


@pytest.fixture(scope="session")
def smplx_v10(smplx_arrays, tmp_path_factory):
    """The same in the v1.0 layout: 10 and 10 columns."""
    shapedirs = smplx_arrays["shapedirs"][:, :, [*range(10), *range(300, 310)]]
    path = _write(tmp_path_factory.mktemp("smplx_v10"), {**smplx_arrays, "shapedirs": shapedirs})
    yield path
    path.unlink()


@pytest.fixture(scope="session")
def other(embedded):
    """The embedded body in another mesh of 10475 vertices, its joints elsewhere."""
    return make(embedded, NUM_VERTICES)


@pytest.fixture(scope="session")
def smaller(embedded):
    """The same in a mesh of 6890 vertices."""
    return make(embedded, 6890)


@pytest.fixture(scope="session")
def other_model(embedded, other):
    """The same as a model named "smplx"."""
    return build_body_model(
        BodyArrays(
            name="smplx",
            topology="smplx",
            template=other.template,
            directions=other.shapedirs.transpose(2, 0, 1),
            joint_template=other.regressor @ other.template,
            joint_directions=np.einsum(
                "jv,vck->kjc", other.regressor, other.shapedirs, optimize=True
            ),
            bind_rot=None,
            weights=other.weights,
            faces=other.faces,
            num_betas=10,
            num_expression=0,
            outer=other.from_embedded @ embedded.outer.double().numpy() > 0.5,
        )
    )


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """A folder in which maps between meshes are kept, for all tests of a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PHYSIC_CACHE", str(tmp_path_factory.mktemp("maps")))
        yield


@pytest.fixture(scope="session")
def people(embedded):
    """Four people in everyday poses: local rotations, betas and transl, float64."""
    rng = np.random.default_rng(0)
    rotvecs = np.zeros((4, 55, 3))

    def turn(name, x=0.0, y=0.0, z=0.0, spread=0.1):
        for side, sign in (("left", 1), ("right", -1)):
            mean = np.array([x, sign * y, sign * z])
            rotvecs[:, JOINT_INDEX[f"{side}_{name}"]] = mean + spread * rng.standard_normal((4, 3))

    turn("hip", -0.5, spread=0.3)
    turn("knee", 0.6, spread=0.05)
    turn("shoulder", 0.0, -0.3, -0.8, 0.3)
    turn("elbow", 0.0, -0.6, 0.0, 0.1)
    for name in ("ankle", "wrist"):
        turn(name)
    for finger in ("index", "middle", "pinky", "ring"):
        for k in (1, 2, 3):
            turn(f"{finger}{k}", 0.0, 0.0, -0.4)
    for name in ("spine1", "spine2", "spine3", "neck", "head"):
        rotvecs[:, JOINT_INDEX[name]] = 0.1 * rng.standard_normal((4, 3))
    rotvecs[:, 0] = 0.3 * rng.standard_normal((4, 3))
    rotvecs[:, 0, 1] += [0, 1.5, -2.5, 3.1]
    place = rng.standard_normal((4, 3)) + np.array([0, 0, 4])
    return {
        "rotations": rotvec_to_rotmat_numpy(rotvecs),
        "betas": rng.standard_normal((4, embedded.num_betas)),
        "transl": place,
    }
