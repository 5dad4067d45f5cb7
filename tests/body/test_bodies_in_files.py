"""Bodies in files of other programs: each form, written here as docs/bodies.md describes it, gives
the joints that were written.
"""

from __future__ import annotations

import json
import pickle
import sys
import zlib
from collections import defaultdict
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

import numpy as np
import pytest
import torch
import trimesh
from other_body import mm, posed, smpl_file_arrays, smplx_file_arrays
from scipy.spatial.transform import Rotation

from physic_core import InputError, read_bodies
from physic_core.body import JOINT_INDEX, PARENTS, load_smpl
from physic_core.body.files import SMPLH, load_smplx
from physic_core.conversion import convert_bodies
from physic_core.geometry.rotations import rotmat_to_rotvec
from physic_core.types import FileOfPhoto
from physic_testing.worlds import load_world
from tests.pipeline.mocks import run

SIZE = (640, 480)
MIDDLE = [319.5, 239.5]


@pytest.fixture(scope="module")
def smplx_path(other, tmp_path_factory):
    arrays = smplx_file_arrays(other)
    hands = np.random.default_rng(1).normal(0, 0.1, (2, 45))
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    np.savez(path, **arrays, hands_meanl=hands[0], hands_meanr=hands[1])
    return path


@pytest.fixture(scope="module")
def smpl_path(smaller, tmp_path_factory):
    path = tmp_path_factory.mktemp("smpl") / "SMPL_NEUTRAL.npz"
    np.savez(path, **smpl_file_arrays(smaller))
    return path


@pytest.fixture(scope="module")
def smplx(people, smplx_path):
    """Vectors (4, 55, 3), betas, transl, and what they pose."""
    turns = rotmat_to_rotvec(people["rotations"])
    betas, transl = people["betas"][:, :10], people["transl"]
    model = load_smplx(smplx_path).double
    given = (torch.from_numpy(v) for v in (people["rotations"], betas, transl))
    out = model(*given)
    return turns, betas, transl, out.joints.numpy(), out.vertices.numpy()


@pytest.fixture(scope="module")
def smpl(people, smpl_path):
    turns = rotmat_to_rotvec(people["rotations"])[:, :24]
    turns[:, 22:] = 0
    betas, transl = people["betas"][:, :10], people["transl"]
    model = load_smpl(smpl_path)
    matrices = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(4, 24, 3, 3)
    given = matrices, betas, transl
    return turns, betas, transl, model.smpl_joints(*given), model.vertices(*given)


def read(path, model=None, frame=None, photo="photo.jpg"):
    return read_bodies(FileOfPhoto(Path(path), photo, SIZE, frame), model and str(model))


def off(found, joints, body=slice(0, 22)):
    return 1000 * np.abs(found.bodies.joints[:, body] - joints[:, body]).max()


def matrices(turns):
    return Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(*turns.shape[:2], 3, 3)


@pytest.mark.parametrize("form", ["vectors", "matrices"])
def test_dictionary_of_smplx(tmp_path, smplx, smplx_path, form):
    turns, betas, transl, joints, _ = smplx
    parts = {"global_orient": (0, 1), "body_pose": (1, 22), "jaw_pose": (22, 23)}
    parts |= {"left_hand_pose": (25, 40), "right_hand_pose": (40, 55)}
    own = {n: (turns[:, a:b].reshape(4, -1)) for n, (a, b) in parts.items()}
    if form == "matrices":
        own = {n: matrices(turns[:, a:b]) for n, (a, b) in parts.items()}
    np.savez(tmp_path / "a.npz", **own, betas=betas, transl=transl)
    assert off(read(tmp_path / "a.npz", smplx_path), joints, slice(0, 55)) < 0.1


def test_dictionary_of_smpl(tmp_path, smpl, smpl_path):
    turns, betas, transl, joints, _ = smpl
    flat = turns.reshape(4, -1)
    values = {
        "global_orient": flat[:, :3],
        "body_pose": flat[:, 3:],
        "betas": betas,
        "transl": transl,
    }
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(values))
    assert off(read(tmp_path / "a.pkl", smpl_path), joints) < 0.1


def test_amass_keys(tmp_path, smplx, smplx_path):
    turns, betas, transl, joints, _ = smplx
    np.savez(tmp_path / "a.npz", poses=turns.reshape(4, -1), betas=betas[2], trans=transl)
    found = read(tmp_path / "a.npz", smplx_path, frame=2)
    assert off(found, joints[2:3], slice(0, 55)) < 0.1
    with pytest.raises(InputError, match="bodies_frame"):
        read(tmp_path / "a.npz", smplx_path)


def smplh_file_arrays(body):
    """A body of 6890 vertices as a SMPL-H file: 52 joints, no jaw and eyes."""
    rows = [*range(22), *range(25, 55)]
    weights = body.weights[:, rows].copy()
    weights[:, 15] += body.weights[:, 22:25].sum(1)
    parents = [PARENTS[row] - 3 * (PARENTS[row] >= 25) for row in rows]
    return smpl_file_arrays(body) | {
        "posedirs": np.zeros((len(body.template), 3, 459), np.float16),
        "J_regressor": body.regressor[rows],
        "weights": weights,
        "kintree_table": np.stack([parents, np.arange(52)]).astype(np.uint32),
    }


def test_amass_keys_of_smplh(tmp_path, people, smaller):
    """156 numbers: root, 21 joints of the body, 15 of the left hand, 15 of the right."""
    np.savez(tmp_path / "SMPLH_NEUTRAL.npz", **smplh_file_arrays(smaller))
    turns = rotmat_to_rotvec(people["rotations"])[:, [*range(22), *range(25, 55)]]
    model = load_smpl(tmp_path / "SMPLH_NEUTRAL.npz", SMPLH)
    joints = model.smpl_joints(matrices(turns), people["betas"][:, :10], people["transl"])
    poses, betas = turns.reshape(4, 156), people["betas"][3, :10]
    np.savez(tmp_path / "a.npz", poses=poses, betas=betas, trans=people["transl"], gender="neutral")
    found = read(tmp_path / "a.npz", tmp_path / "SMPLH_NEUTRAL.npz", frame=3)
    assert off(found, joints[3:]) < 0.1
    hands = found.bodies.joints[:, 25:] - joints[3:, 22:]
    assert 1000 * np.abs(hands).max() < 0.1


def test_gvhmr(tmp_path, smplx, smplx_path):
    turns, betas, transl, joints, _ = smplx
    incam = {
        "global_orient": turns[:, 0],
        "body_pose": turns[:, 1:22].reshape(4, 63),
        "betas": np.repeat(betas[1:2], 4, 0),
        "transl": transl,
    }
    tensors = {name: torch.from_numpy(value).float() for name, value in incam.items()}
    K = torch.tensor([[800.0, 0, 319.5], [0, 800, 239.5], [0, 0, 1]]).repeat(4, 1, 1)
    document = {"smpl_params_incam": tensors, "smpl_params_global": tensors, "K_fullimg": K}
    torch.save(document, tmp_path / "hmr4d_results.pt")
    found = read(tmp_path / "hmr4d_results.pt", smplx_path, frame=1)
    assert off(found, joints[1:2]) < 0.1
    np.testing.assert_allclose(found.camera, [[800, 800, *MIDDLE]])


def test_prompt_hmr(tmp_path, smplx, smplx_path):
    turns, betas, transl, joints, vertices = smplx
    document = {
        "pose": torch.zeros(4, 132),
        "rotmat": torch.from_numpy(matrices(turns[:, :22])),
        "betas": torch.from_numpy(betas),
        "transl": torch.from_numpy(transl),
        "vertices": torch.from_numpy(vertices),
        "cam_int": torch.eye(3).repeat(4, 1, 1),
    }
    torch.save(document, tmp_path / "output.pt")
    found = read(tmp_path / "output.pt", smplx_path)
    assert off(found, joints) < 0.1
    np.testing.assert_allclose(found.camera, [[800, 800, *MIDDLE]] * 4)  # the diagonal


def test_smpler_x_of_all_people_of_a_photo(tmp_path, smplx, smplx_path):
    turns, betas, transl, joints, _ = smplx
    (tmp_path / "smplx").mkdir()
    (tmp_path / "meta").mkdir()
    with np.load(smplx_path) as file:
        mean = np.concatenate([file["hands_meanl"], file["hands_meanr"]]).reshape(30, 3)
    for i in range(3):
        np.savez(
            tmp_path / "smplx" / f"00001_{2 * i}.npz",
            global_orient=turns[i, :1],
            body_pose=turns[i, 1:22],
            left_hand_pose=turns[i, 25:40] - mean[:15],
            right_hand_pose=turns[i, 40:] - mean[15:],
            jaw_pose=turns[i, 22:23],
            leye_pose=np.zeros((1, 3)),
            reye_pose=np.zeros((1, 3)),
            betas=betas[i : i + 1],
            expression=np.zeros((1, 10)),
            transl=transl[i : i + 1] * [1, 1, 20],
        )
        meta = {"focal": [9000.0 + i, 9000], "princpt": [300, 200 + i], "img_path": "x/000001.jpg"}
        (tmp_path / "meta" / f"00001_{2 * i}.json").write_text(json.dumps(meta))
    found = read(tmp_path / "smplx", smplx_path, photo="000001.jpg")
    far = joints[:3] + (transl * [0, 0, 19])[:3, None]
    assert off(found, far, slice(0, 55)) < 0.1
    np.testing.assert_allclose(found.camera[2], [9002, 9000, 300, 202])


class NumpyArrayWrapper:
    """What joblib writes before the bytes of an array."""

    __module__ = "joblib.numpy_pickle"

    def __init__(self, array):
        self.subclass, self.shape, self.dtype = np.ndarray, array.shape, array.dtype
        self.order, self.allow_mmap, self.numpy_array_alignment_bytes = "C", True, 16


def joblib_dump(values):
    """The bytes of ``joblib.dump``: the state of each array, padding, and its numbers."""
    import io

    stream = io.BytesIO()

    class Pickler(pickle._Pickler):
        def save(self, obj, *args):
            if type(obj) is not np.ndarray:
                return super().save(obj, *args)
            super().save(NumpyArrayWrapper(obj), *args)
            self.framer.commit_frame(force=True)
            padding = 16 - (stream.tell() + 1) % 16
            stream.write(bytes([padding]) + b"\xff" * padding + obj.tobytes())
            return None

    module = ModuleType("joblib.numpy_pickle")
    module.NumpyArrayWrapper = NumpyArrayWrapper
    names = {"joblib": ModuleType("joblib"), "joblib.numpy_pickle": module}
    with patch.dict(sys.modules, names):
        Pickler(stream, protocol=4).dump(values)
    return stream.getvalue()


@pytest.mark.parametrize("pack", [bytes, zlib.compress])
def test_wham(tmp_path, smpl, smpl_path, pack):
    turns, betas, transl, joints, vertices = smpl
    document = defaultdict(dict)
    for i in range(2):  # person i is in the pictures 5 + i and 6 + i
        document[i] = {
            "pose": turns[[i, i + 1]].reshape(2, 72).astype(np.float32),
            "trans": transl[[i, i + 1]].astype(np.float32),
            "pose_world": np.zeros((2, 72), np.float32),
            "trans_world": np.zeros((2, 3), np.float32),
            "betas": betas[[i, i + 1]].astype(np.float32),
            "verts": vertices[[i, i + 1]].astype(np.float32),
            "frame_ids": np.array([5 + i, 6 + i]),
        }
    (tmp_path / "wham_output.pkl").write_bytes(pack(joblib_dump(document)))
    found = read(tmp_path / "wham_output.pkl", smpl_path, frame=6)
    assert off(found, joints[[1, 1]]) < 0.1
    with pytest.raises(InputError, match="bodies_frame"):
        read(tmp_path / "wham_output.pkl", smpl_path)
    with pytest.raises(InputError, match="bodies_frame"):
        read(tmp_path / "wham_output.pkl", smpl_path, frame=99)


def sam_people(embedded, other_mhr, people):
    """SAM 3D Body's dictionaries of the embedded body in a mesh of 18439 vertices."""
    gather = other_mhr[2]
    out = embedded(*(torch.from_numpy(people[n]) for n in ("rotations", "betas", "transl")))
    place = people["transl"]
    found = []
    for i in range(4):
        found.append(
            {
                "bbox": np.array([10.0, 20, 30, 40]),
                "focal_length": np.float32(750),
                "pred_vertices": gather @ out.vertices[i].numpy() - place[i],
                "pred_cam_t": place[i],
                "pred_keypoints_3d": np.zeros((70, 3)),
                "mhr_model_params": np.zeros(204),
                "mask": None,
            }
        )
    return found, out.joints.numpy()


@pytest.fixture(scope="module")
def mhr(embedded64, tmp_path_factory):
    """The embedded body in a mesh of 18439 vertices: each of some triangles has one more."""
    template = embedded64(*embedded64.zero_pose()).vertices[0].numpy()
    faces = embedded64.faces.numpy()
    count = 18439 - len(template)
    chosen = np.linspace(0, len(faces) - 1, count).astype(int)
    from scipy.sparse import csr_matrix, identity, vstack

    rows = np.repeat(np.arange(count), 3)
    thirds = np.full(3 * count, 1 / 3)
    more = csr_matrix((thirds, (rows, faces[chosen].ravel())), (count, len(template)))
    gather = vstack([identity(len(template)), more]).tocsr()
    added = len(template) + np.arange(count)
    a, b, c = faces[chosen].T
    split = [np.stack(t, 1) for t in ((a, b, added), (b, c, added), (c, a, added))]
    every = np.concatenate([np.delete(faces, chosen, 0), *split])
    path = tmp_path_factory.mktemp("mhr") / "mhr.npz"
    np.savez(path, vertices=gather @ template, faces=every)
    return gather @ template, every, gather, path


def converted_mm(found, joints, embedded64):
    """Mean distance of joints after the conversion to the embedded body."""
    bodies = convert_bodies(found.bodies, embedded64.to(dtype=torch.float32)).bodies
    return mm(posed(embedded64, bodies.parameters)[1][:, :22], joints[:, :22])


def test_sam_3d_body(tmp_path, embedded64, mhr, people, maps):
    given, joints = sam_people(embedded64, mhr[:3], people)
    np.savez(tmp_path / "a.npz", people=np.array(given, dtype=object))
    found = read(tmp_path / "a.npz", mhr[3])
    assert converted_mm(found, joints, embedded64) < 2
    np.testing.assert_allclose(found.camera, [[750, 750, *MIDDLE]] * 4)


MHR70 = {
    5: "left_shoulder",
    6: "right_shoulder",
    7: "left_elbow",
    8: "right_elbow",
    9: "left_hip",
    10: "right_hip",
    11: "left_knee",
    12: "right_knee",
    13: "left_ankle",
    14: "right_ankle",
    41: "right_wrist",
    62: "left_wrist",
}  # of sam_3d_body/metadata/mhr70.py


def test_keypoints_of_sam_3d_body_need_no_model(tmp_path, smplx):
    *_, transl, joints, _ = smplx
    places = {k: joints[:, JOINT_INDEX[name]] - transl for k, name in MHR70.items()}
    points = np.zeros((4, 70, 3), np.float32)
    for k, place in places.items():
        points[:, k] = place
    given = [
        {"pred_cam_t": transl[i], "pred_keypoints_3d": points[i], "focal_length": 750.0}
        for i in range(4)
    ]
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(given))
    found = read(tmp_path / "a.pkl").bodies.joints
    rows = [JOINT_INDEX[name] for name in MHR70.values()]
    assert 1000 * np.abs(found[:, rows] - joints[:, rows]).max() < 0.1


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("focal_length", np.nan, "nan px"),
        ("focal_length", np.array(750 + 1j), "focal_length"),
        ("pred_keypoints_3d", np.full((70, 3), np.nan), "nowhere"),
        ("pred_keypoints_3d", np.full((70, 3), 1e30), "1e.30 m away"),
    ],
)
def test_a_body_or_camera_that_cannot_be_is_refused(tmp_path, key, value, words):
    person = {
        "pred_cam_t": [0.0, 0, 3],
        "pred_keypoints_3d": np.random.default_rng(0).random((70, 3)),
    }
    (tmp_path / "a.pkl").write_bytes(pickle.dumps([{**person, "focal_length": 750.0, key: value}]))
    with pytest.raises(InputError, match=words):
        read(tmp_path / "a.pkl")


def test_ply_of_sam_3d_body(tmp_path, embedded64, mhr, people, maps):
    given, joints = sam_people(embedded64, mhr[:3], people)
    body = given[1]["pred_vertices"] + given[1]["pred_cam_t"]
    trimesh.Trimesh(body * [1, -1, -1], mhr[1], process=False).export(tmp_path / "a_mesh_000.ply")
    (tmp_path / "a_focal_length.json").write_text(json.dumps({"focal_length": 700.0}))
    found = read(tmp_path / "a_mesh_000.ply", mhr[3])
    assert converted_mm(found, joints[1:2], embedded64) < 2
    np.testing.assert_allclose(found.camera, [[700, 700, *MIDDLE]])


def test_obj_of_4d_humans(tmp_path, embedded64, smaller, smpl_path, people, maps):
    out = embedded64(*(torch.from_numpy(people[n]) for n in ("rotations", "betas", "transl")))
    far = smaller.from_embedded @ out.vertices[0].numpy() + [0, 0, 50]
    path = tmp_path / "photo_0.obj"
    trimesh.Trimesh(far * [1, -1, -1], smaller.faces, process=False).export(path)
    found = read(path, smpl_path)
    joints = out.joints[:1].numpy() + np.array([0, 0, 50])
    assert converted_mm(found, joints, embedded64) < 2
    np.testing.assert_allclose(found.camera[0, 0], 5000 / 256 * 640)
    nearer = far - [1, 0, 10]
    for name, body in (("photo_1.obj", nearer), ("other_0.obj", far)):
        trimesh.Trimesh(body * [1, -1, -1], smaller.faces, process=False).export(tmp_path / name)
    both = read(tmp_path, smpl_path)
    assert converted_mm(both, np.stack([joints[0], joints[0] - [1, 0, 10]]), embedded64) < 2


def test_keypoints_place_an_obj_without_a_place(tmp_path, smaller, smpl_path, maps):
    world = load_world("stand", (160, 120))
    body = smaller.from_embedded @ (world.vertices[0] - world.parameters.transl[0])
    trimesh.Trimesh(body, smaller.faces, process=False).export(tmp_path / "photo_000000.obj")
    files = f"photo.bodies={tmp_path / 'photo_000000.obj'}", f"photo.bodies_model={smpl_path}"
    found = run(world.image, *files, intrinsics=world.intrinsics)
    apart = np.linalg.norm(found.people[0].given_joints[:22] - world.joints[0, :22], axis=1)
    assert apart.mean() < 0.02


def test_arrays_and_glb_of_multi_hmr(tmp_path, embedded64, other, smplx_path, people, maps):
    out = embedded64(*(torch.from_numpy(people[n]) for n in ("rotations", "betas", "transl")))
    bodies = np.stack([other.from_embedded @ body.numpy() for body in out.vertices])
    np.save(tmp_path / "a.npy", bodies.astype(np.float32))
    found = read(tmp_path / "a.npy", smplx_path)
    assert converted_mm(found, out.joints.numpy(), embedded64) < 2
    np.testing.assert_allclose(found.camera[0, 0], 0.5 * 640 / np.tan(np.pi / 6))
    scene = trimesh.Scene(
        {
            "picture": trimesh.creation.box(),
            "person": trimesh.Trimesh(bodies[1] * [-1, -1, 1], other.faces, process=False),
        }
    )
    scene.export(tmp_path / "a.glb")
    found = read(tmp_path / "a.glb", smplx_path)
    assert converted_mm(found, out.joints[1:2].numpy(), embedded64) < 2
