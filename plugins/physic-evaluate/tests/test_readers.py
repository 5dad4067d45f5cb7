"""Readers of other methods: miniatures in their formats give the body that was written, in the camera frame."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import roma
import torch
import trimesh

from physic_core.errors import InputError
from physic_evaluate.cameras import Camera
from physic_evaluate.contract import Frame, Prediction, TruePerson, Truth
from physic_evaluate.frame_of_results import check_frame
from physic_evaluate.readers import open_reader
from physic_evaluate.readers.physic_release import released_contact

from .miniatures import SIZE, STANDING, Files, K, moved_by, python2_pickle, rigid, rotation

POSE = {"body_pose": 0.2 * np.sin(np.arange(63.0)), "betas": np.linspace(-1, 1, 10)}
SMALLER = np.diag([0.4, 0.4, 1.0]) @ K


def frame_of(name: str = "vicon_03301_01/s001_frame_00012__00.00.00.400") -> Frame:
    return Frame(name, name.partition("/")[0], Truth, Camera(K, *SIZE, np.eye(3), np.zeros(3)))


def true_body(files: Files) -> tuple[np.ndarray, np.ndarray]:
    body = files.bodies.smplx_body(STANDING | POSE)
    return body.vertices, body.joints


def parameters() -> dict[str, np.ndarray]:
    return {k: np.array(v, np.float64)[None] for k, v in (STANDING | POSE).items()}


def six(rotvecs: np.ndarray) -> np.ndarray:
    """The first two columns of each rotation, one after the other."""
    matrices = roma.rotvec_to_rotmat(torch.from_numpy(np.array(rotvecs, np.float64).reshape(-1, 3))).numpy()
    return np.concatenate([matrices[:, :, 0], matrices[:, :, 1]], 1)


def write_holistic(folder: Path, files: Files, frame: Frame) -> None:
    vertices, _ = true_body(files)
    name = frame.id.rpartition("/")[2]
    mesh = folder / "meshes" / name / "000.ply"
    mesh.parent.mkdir(parents=True)
    trimesh.Trimesh(vertices, files.standing().faces, process=False).export(mesh)
    python2_pickle(folder / "results" / name / "000.pkl", parameters() | {"camera_rotation": np.eye(3)[None]})


def write_mover(folder: Path, files: Files, frame: Frame) -> None:
    values = {k: np.repeat(v, 20, 0) + 0.01 * np.arange(20)[:, None] for k, v in parameters().items() if k != "betas"}
    for name, value in parameters().items():
        if name != "betas":
            values[name][12] = value[0]
    path = folder / frame.sequence / "results" / "001_all.pkl"
    path.parent.mkdir(parents=True)
    path.write_bytes(pickle.dumps(values | {"betas": parameters()["betas"], "gender": "neutral"}))


def write_hsfm(folder: Path, files: Files, frame: Frame) -> None:
    vertices, joints = true_body(files)
    cam2world = rigid(rotation("y", 40) @ rotation("x", 10), [1.0, -2.0, 0.5])
    orient = roma.rotvec_to_rotmat(torch.tensor(STANDING["global_orient"], dtype=torch.float64)).numpy()
    turned = roma.rotmat_to_rotvec(torch.from_numpy(cam2world[:3, :3] @ orient)).numpy()
    person = {k: v.reshape(1, -1) for k, v in parameters().items() if k != "transl"}
    person |= {"global_orient": turned.reshape(1, -1), "root_transl": moved_by(cam2world, joints[:1])}
    camera = {"cam2world": cam2world, "intrinsic": SMALLER.copy(), "rgbimg": np.zeros((192, 256, 3), np.float32)}
    camera["intrinsic"][:2, 2] = (K[:2, 2] + 0.5) * 0.4 - 0.5
    camera["pts3d"] = moved_by(cam2world, vertices[:12]).reshape(3, 4, 3)
    path = folder / frame.sequence / "hsfm_output_smplx.pkl"
    path.parent.mkdir(parents=True)
    values = {"hsfm_places_cameras": {frame.id.rpartition("/")[2]: camera, "other": camera | {"cam2world": np.eye(4)}}}
    path.write_bytes(pickle.dumps(values | {"hsfm_people(smplx_params)": {1: person}}))


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


def write_phy_sic(folder: Path, files: Files, frame: Frame) -> None:
    vertices, _ = true_body(files)
    body = {"global_orient": six(np.array(STANDING["global_orient"]))[None], "body_pose": six(POSE["body_pose"])[None]}
    mask = np.zeros((4, 5), bool)
    mask[1, :3] = True
    values = {"K": K, "scale": np.float32(1.25), "inlier_mask": mask, "pts3d": vertices[:3] / 1.25, "depth": mask * 1.0}
    values |= {"normals": np.tile([0.0, 0, -1], (4, 5, 1)), "plane_points": vertices[3:7] / 1.25}
    values |= {"plane_normal": np.array([0.0, -1, 0]), "body_params": body | {"betas": POSE["betas"][None]}}
    path = folder / frame.id.rpartition("/")[2] / "scene_data_final.pkl"
    path.parent.mkdir(parents=True)
    path.write_bytes(pickle.dumps(values | {"cam_trans": np.array([STANDING["transl"]])}))


def write_human3r(folder: Path, files: Files, frame: Frame) -> None:
    _, joints = true_body(files)
    rotvec = np.zeros((1, 53, 3))
    rotvec[0, 0], rotvec[0, 1:22] = STANDING["global_orient"], POSE["body_pose"].reshape(21, 3)
    for part in ("smpl", "camera"):
        (folder / frame.sequence / part).mkdir(parents=True)
    arrays = {"shape": POSE["betas"][None], "rotvec": rotvec, "transl": joints[15:16], "scores": np.zeros((1, 4, 4))}
    np.savez(folder / frame.sequence / "smpl" / "000012.npz", **arrays)
    intrinsics = np.array([[200.0, 0, 128], [0, 200, 96], [0, 0, 1]])
    np.savez(folder / frame.sequence / "camera" / "000012.npz", pose=np.eye(4), intrinsics=intrinsics)


WRITERS = {
    "holistic-mesh": write_holistic,
    "mover": write_mover,
    "hsfm": write_hsfm,
    "physic-release": write_release,
    "phy-sic": write_phy_sic,
    "human3r": write_human3r,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_reader_gives_the_body_in_the_camera_frame(name: str, files: Files, tmp_path: Path):
    frame = frame_of()
    WRITERS[name](tmp_path, files, frame)
    found = open_reader(name, tmp_path, files.bodies).result(frame)
    assert found is not None
    vertices, joints = true_body(files)
    (person,) = found.people
    assert person.topology == "smplx"
    np.testing.assert_allclose(person.vertices, vertices, atol=2e-5)
    np.testing.assert_allclose(person.joints[:22], joints[:22], atol=2e-5)  # type: ignore[index]
    if name == "hsfm":
        np.testing.assert_allclose(found.K, K, atol=1e-6)
        np.testing.assert_allclose(found.scene_points, vertices[:12], atol=1e-9)
    if name == "human3r":
        np.testing.assert_allclose(found.K, [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    if name in ("physic-release", "phy-sic"):
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


def test_sam_3d_body_has_several_files_a_picture(files: Files, tmp_path: Path):
    rng = np.random.default_rng(1)
    frame = frame_of("photo")
    for i in range(2):
        keypoints = rng.uniform(-0.5, 0.5, (70, 3))
        arrays = {"pred_vertices": rng.uniform(-0.8, 0.8, (18439, 3)), "pred_keypoints_3d": keypoints}
        np.savez(tmp_path / f"photo_{i}.npz", **arrays, pred_cam_t=np.array([i, 0, 4.0]), focal_length=480.0)
    found = open_reader("sam-3d-body", tmp_path, files.bodies).result(frame)
    assert found is not None
    assert [person.topology for person in found.people] == ["mhr", "mhr"]
    row = found.people[1].joint_names.index("left_wrist")
    np.testing.assert_allclose(found.people[1].joints[row], keypoints[62] + [1, 0, 4])  # type: ignore[index]
    np.testing.assert_allclose(found.K, [[480, 0, 320], [0, 480, 240], [0, 0, 1]])


def test_torch_tensors_and_code_in_pickles_are_refused_by_name(files: Files, tmp_path: Path):
    frame = frame_of()
    path = tmp_path / frame.id.rpartition("/")[2] / "scene_data_final.pkl"
    path.parent.mkdir()
    path.write_bytes(pickle.dumps({"K": torch.eye(3)}))
    with pytest.raises(InputError, match=r"holds torch._utils._rebuild_tensor_v2, which is refused"):
        open_reader("phy-sic", tmp_path, files.bodies).result(frame)
    write_hsfm(tmp_path / "hsfm", files, frame)
    file = next((tmp_path / "hsfm").rglob("*.pkl"))
    file.write_bytes(file.read_bytes()[:3000])
    with pytest.raises(InputError, match="is not a complete pickle"):
        open_reader("hsfm", tmp_path / "hsfm", files.bodies).result(frame)


def test_results_in_the_world_frame_are_refused_as_camera_results(files: Files):
    to_camera = rigid(rotation("y", 30) @ rotation("x", 95), [0.2, 0.4, 3.0])
    camera = Camera(K, *SIZE, to_camera[:3, :3], to_camera[:3, 3])
    vertices, joints = true_body(files)
    truth = Truth((TruePerson(vertices=vertices, topology="smplx"),))
    frame = Frame("a", "a", lambda: truth, camera)
    from physic_evaluate.contract import PredictedPerson

    own = Prediction((PredictedPerson(vertices=camera.in_world(vertices), topology="smplx", joints=joints),))
    with pytest.raises(InputError, match="give --results-frame theirs=world"):
        check_frame([(frame, truth, own)], "theirs", "camera")
    check = check_frame([(frame, truth, own)], "theirs", "world")
    assert check.overlap["world"] == pytest.approx(1)
