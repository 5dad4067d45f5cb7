"""The reader of the published results, pickles, and frames of reference."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import roma
import torch

from physic_bench.cameras import Camera
from physic_bench.contract import Frame, PredictedPerson, Prediction, TruePerson, Truth
from physic_bench.frame_of_results import check_frame
from physic_bench.pickled import pickled_arrays
from physic_bench.readers import open_reader
from physic_bench.readers.physic_release import released_contact
from physic_core.errors import InputError

from .miniatures import SIZE, STANDING, Files, K, rigid, rotation

POSE = {"body_pose": 0.2 * np.sin(np.arange(63.0)), "betas": np.linspace(-1, 1, 10)}


def frame_of(name: str = "vicon_03301_01/s001_frame_00012__00.00.00.400") -> Frame:
    return Frame(name, name.partition("/")[0], Truth, Camera(K, *SIZE, np.eye(3), np.zeros(3)))


def true_body(files: Files) -> tuple[np.ndarray, np.ndarray]:
    body = files.bodies.smplx_body(STANDING | POSE)
    return body.vertices, body.joints


def six(rotvecs: np.ndarray) -> np.ndarray:
    """The first two columns of each rotation, one after the other."""
    matrices = roma.rotvec_to_rotmat(torch.from_numpy(np.array(rotvecs, np.float64).reshape(-1, 3))).numpy()
    return np.concatenate([matrices[:, :, 0], matrices[:, :, 1]], 1)


def write_release(folder: Path, files: Files, frame: Frame) -> None:
    vertices, _ = true_body(files)
    arrays: dict[str, Any] = {"K": K, "contact_deco": np.r_[np.ones(7), np.zeros(10468)].astype(np.float32)}
    arrays |= {"scene_points": vertices[:5] + np.array([0, 0.015, 0]), "scene_normals": np.tile([0.0, -1, 0], (5, 1))}
    for prefix, shift in (("init", 0.3), ("final", 0.0)):
        arrays |= {f"{prefix}_global_orient": six(np.array(STANDING["global_orient"]))[None]}
        arrays |= {f"{prefix}_body_pose": six(POSE["body_pose"])[None], f"{prefix}_betas": POSE["betas"][None]}
        arrays |= {f"{prefix}_cam_trans": np.array([STANDING["transl"]]) + np.array([0, 0, shift])}
    path = folder / "release_data" / "prox" / f"{frame.id}.npz"
    path.parent.mkdir(parents=True)
    np.savez(path, **arrays)


def test_the_end_of_the_release_is_the_body_in_the_camera_frame(files: Files, tmp_path: Path):
    frame = frame_of()
    write_release(tmp_path, files, frame)
    found = open_reader("physic-release", tmp_path, files.bodies).result(frame)
    assert found is not None
    vertices, joints = true_body(files)
    (person,) = found.people
    assert person.topology == "smplx"
    np.testing.assert_allclose(person.vertices, vertices, atol=2e-5)
    np.testing.assert_allclose(person.joints[:22], joints[:22], atol=2e-5)  # type: ignore[index]
    # Scene points 1.5 cm below some vertices: those within 2 cm touch.
    near = released_contact(vertices, np.asarray(found.scene_points), None)
    assert person.contact is not None
    assert near.sum() > 0
    assert not (near & ~person.contact).any()


def test_the_start_of_the_release_is_another_body_with_the_contact_of_deco(files: Files, tmp_path: Path):
    frame = frame_of()
    write_release(tmp_path, files, frame)
    found = open_reader("physic-release-init", tmp_path, files.bodies).result(frame)
    assert found is not None
    np.testing.assert_allclose(found.people[0].vertices, true_body(files)[0] + [0, 0, 0.3], atol=2e-5)
    assert found.people[0].contact.sum() == 7  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (pickle.dumps({"K": torch.eye(3)}), "holds torch._utils._rebuild_tensor_v2, which is refused"),
        (pickle.dumps({"K": np.eye(30)})[:3000], "is not a complete pickle"),
    ],
)
def test_torch_tensors_and_cut_off_pickles_are_refused(content: bytes, reason: str, tmp_path: Path):
    (tmp_path / "a.pkl").write_bytes(content)
    with pytest.raises(InputError, match=reason):
        pickled_arrays(tmp_path / "a.pkl")


def test_the_frame_of_results_is_found_and_results_of_other_pictures_are_refused(files: Files):
    to_camera = rigid(rotation("y", 30) @ rotation("x", 95), [0.2, 0.4, 3.0])
    camera = Camera(K, *SIZE, to_camera[:3, :3], to_camera[:3, 3])
    vertices, joints = true_body(files)
    truth = Truth((TruePerson(vertices=vertices, topology="smplx"),))
    frame = Frame("a", "a", lambda: truth, camera)
    own = Prediction((PredictedPerson(vertices=camera.in_world(vertices), topology="smplx", joints=joints),))
    check = check_frame([(frame, truth, own)], "theirs")
    assert (check.frame, check.overlap["world"]) == ("world", pytest.approx(1))
    elsewhere = Prediction((PredictedPerson(vertices=vertices + np.array([9, 0, 0]), topology="smplx"),))
    with pytest.raises(InputError, match="theirs do not project"):
        check_frame([(frame, truth, elsewhere)], "theirs")
