"""Files of bodies that are wrong: each is refused by what is wrong with it, or warned of."""

from __future__ import annotations

import pickle
import zlib
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physic_core import ConfigError, InputError, write_bodies
from physic_core.types import Bodies
from tests.pipeline.mocks import run

pytestmark = pytest.mark.usefixtures("few_steps")


def own(change=lambda p: {}, sigma_m=0.06, **camera):
    """Write the true body in the project's own format, with changes of parameters and camera."""

    def write(path, world):
        values = {k: np.asarray(v, np.float32) for k, v in change(world.parameters).items()}
        changed = replace(world.intrinsics, **camera)
        write_bodies(path, replace(world.parameters, **values), "embedded", changed, sigma_m)

    return write


def without(name):
    """Write the project's own format without an array."""

    def write(path, world):
        own()(path, world)
        with np.load(path) as file:
            kept = {key: file[key] for key in file.files if key != name}
        np.savez(path, **kept)

    return write


def smplx(**changes):
    """Write one body as a dictionary of SMPL-X."""
    values = {
        "global_orient": np.zeros((1, 3)),
        "body_pose": np.zeros((1, 63)),
        "betas": np.zeros((1, 10)),
        "transl": np.array([[0, 0, 4.0]]),
    }
    return lambda path, world: np.savez(path, **(values | changes))


def mesh(vertices, size):
    """Write a mesh with so many vertices, of a size in meters."""
    points = size * (np.random.default_rng(0).random((1, vertices, 3)) + np.array([0, 0, 3]))
    return lambda path, world: write_array(path, points)


def write_array(path, array):
    with path.open("wb") as stream:
        np.save(stream, array)


def content(data):
    return lambda path, world: path.write_bytes(data)


def cut(write):
    """Write the first half of a file."""

    def half(path, world):
        write(path, world)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return half


def turned(parameters, matrix):
    old = Rotation.from_rotvec(parameters.global_orient).as_matrix()
    return Rotation.from_matrix(np.array(matrix) @ old).as_rotvec()


PARTS = {"global_orient": 3, "body_pose": 63, "betas": 10, "transl": 3}


def film(path, world):
    tensors = {name: torch.zeros(5, width) for name, width in PARTS.items()}
    torch.save({"smpl_params_incam": tensors}, path)


TWICE = 2 * np.eye(3)[None]
MIRRORED = np.diag([1.0, 1, -1])[None]
ZEROS = dict.fromkeys(("left_hand_pose", "right_hand_pose"), np.zeros((1, 6)))
WRONG = {
    "degrees": (own(lambda p: {"global_orient": np.degrees(p.global_orient)}), "in degrees"),
    "degrees of SMPL-X": (smplx(body_pose=np.full((1, 63), 45.0)), "in degrees"),
    "millimeters": (own(lambda p: {"transl": 1000 * p.transl}), "in millimeters"),
    "centimeters": (own(lambda p: {"transl": 100 * p.transl}), "another (photo|size)|meters"),
    "a mesh in millimeters": (mesh(6890, 1700), "or millimeters"),
    "scaled matrices": (smplx(global_orient=TWICE), "no rotations"),
    "mirrored matrices": (smplx(global_orient=MIRRORED), "no rotations"),
    "behind the camera": (own(lambda p: {"transl": -p.transl}), "behind the camera"),
    "40 m up": (own(lambda p: {"transl": p.transl - [0, 40, 0]}), "world coordinates"),
    "y up": (
        own(lambda p: {"global_orient": turned(p, np.diag([1, -1, -1]))}),
        "upside down",
    ),
    "another photo": (
        own(lambda p: {"transl": p.transl * [1, 1, 4] + [3, -2.5, 0]}),
        "another photo",
    ),
    "a larger photo": (own(width=200), "200 x 120"),
    "a camera in shares": (own(fx=1.2, fy=1.6, cx=0.5, cy=0.5), "focal length of 1.2 px"),
    "no error": (own(sigma_m=-1.0), "sigma_m must be above 0"),
    "numbers of people": (smplx(transl=np.zeros((2, 3))), "different numbers of people"),
    "shapes of arrays": (own(lambda p: {"betas": np.zeros((2, 16))}), r"betas must be \(1, 16\)"),
    "nobody": (own(lambda p: {n: v[:0] for n, v in vars(p).items()}), "no person"),
    "quaternions": (smplx(body_pose=np.full((1, 21, 4), 0.5)), "28 joints"),
    "another topology": (mesh(5023, 1.7), "5023 vertices"),
    "20 joints": (smplx(body_pose=np.zeros((1, 60))), "20 joints"),
    "components of hands": (smplx(**ZEROS), "PCA components"),
    "not finite": (own(lambda p: {"transl": np.nan * p.transl}), "finite"),
    "a huge shape": (smplx(betas=np.full((1, 10), 400.0)), "betas must lie within"),
    "no model": (smplx(), r"photo\.bodies_model"),
    "no picture of a film": (film, r"photo\.bodies_frame"),
    "an array that lacks": (without("transl"), "lacks the arrays transl"),
    "half of a mesh": (cut(mesh(6890, 1.7)), "cannot be (used|read)"),
    "half of a film": (cut(film), "cannot be (used|read)"),
    "half of a pickle": (content(pickle.dumps({"a": np.zeros(99)})[:-200]), "damaged pickle"),
    "half of joblib's": (content(b"\x78\x9c"), "cannot be used"),
    "a text": (content(b"hello"), "format is unknown"),
    "JSON": (content(b"{}"), "format is unknown"),
    "nothing": (content(b""), "format is unknown"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_file_is_named(tmp_path, world, name):
    write, words = WRONG[name]
    write(tmp_path / "bodies.npz", world)
    with pytest.raises(InputError, match=words):
        run(world.image, f"photo.bodies={tmp_path / 'bodies.npz'}", intrinsics=world.intrinsics)


WRONG_RECORDS = {
    "degrees": (lambda p: {"global_orient": np.degrees(p.global_orient)}, "in degrees"),
    "numbers of people": (lambda p: {"betas": np.zeros((3, 16), np.float32)}, "betas must be"),
}


@pytest.mark.parametrize("name", WRONG_RECORDS)
def test_wrong_record_is_named(world, name):
    change, words = WRONG_RECORDS[name]
    given = Bodies(replace(world.parameters, **change(world.parameters)), "embedded")
    with pytest.raises(InputError, match=words):
        run(world.image, bodies=given, intrinsics=world.intrinsics)


def test_a_path_is_no_mask(world):
    with pytest.raises(ConfigError, match="masks of people"):
        run(world.image, masks="masks.npz")


DOUBTFUL = {
    "faces away": (
        own(lambda p: {"global_orient": turned(p, np.diag([-1, 1, -1]))}),
        "left and right of the given bodies seem swapped by the keypoints of person 0",
    ),
    "another pose": (
        own(lambda p: {"body_pose": np.full((1, 63), 0.7)}),
        "far from the keypoints of person 0",
    ),
}


@pytest.mark.parametrize("name", DOUBTFUL)
def test_body_that_keypoints_contradict_is_warned_of(tmp_path, world, name):
    write, words = DOUBTFUL[name]
    write(tmp_path / "bodies.npz", world)
    found = run(world.image, f"photo.bodies={tmp_path / 'bodies.npz'}", intrinsics=world.intrinsics)
    assert any(words in warning for warning in found.warnings)


class Runs:
    def __reduce__(self):
        return (print, ("code of the file ran",))


def code_in_npy(path):
    write_array(path, np.array([Runs()], dtype=object))


CODE = {
    "pickle": lambda path: path.write_bytes(pickle.dumps({"a": Runs()})),
    "packed pickle": lambda path: path.write_bytes(zlib.compress(pickle.dumps({"a": Runs()}))),
    "torch": lambda path: torch.save({"smpl_params_incam": Runs()}, path),
    "npy": code_in_npy,
    "npz": lambda path: np.savez(path, people=np.array([Runs()], dtype=object)),
}


@pytest.mark.parametrize("form", CODE)
def test_no_file_runs_code(tmp_path, world, capsys, form):
    CODE[form](tmp_path / "bodies.npz")
    with pytest.raises(InputError, match=r"could run code(.|\n)*torch\.save"):
        run(world.image, f"photo.bodies={tmp_path / 'bodies.npz'}", intrinsics=world.intrinsics)
    assert "code of the file ran" not in capsys.readouterr().out
