"""``physic evaluate rich`` on a miniature: two people, two cameras, one scan, annotated contact."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from PIL import Image

from physic_bench.datasets.base import FrameChoice
from physic_bench.datasets.rich import DATA_SET
from physic_core.body.joints import JOINT_NAMES

from .miniatures import (
    STANDING,
    figures,
    moved_by,
    python2_pickle,
    rigid,
    rotation,
    run,
    write_plain,
)

SEQUENCE = "LectureHall_009_021_lunge1"
K = np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]])
VIEWS = {0: np.eye(4), 3: rigid(rotation("y", -35), [2.0, 0, 0.6])}


def parameters_of(row):
    place = [1.1 * row - 0.4, 0.35, 3.6]
    return STANDING | {"transl": place, "left_hand_pose": 0.2 * np.ones(12)}


@pytest.fixture(scope="module")
def root(files, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rich")
    bodies = folder / "bodies" / "test" / SEQUENCE / "00042"
    contacts = folder / "human_scene_contact" / "test" / SEQUENCE / "00042"
    contacts.mkdir(parents=True)
    for row, subject in enumerate(("009", "021")):
        parameters = parameters_of(row)
        python2_pickle(
            bodies / f"{subject}.pkl",
            {k: np.array(v, np.float32)[None] for k, v in parameters.items()},
        )
        labels = np.zeros(6890, np.int64)
        labels[: 100 + row] = 1
        python2_pickle(
            contacts / f"{subject}.pkl", {"contact": labels, "s2m_dist_id": np.zeros((4, 3))}
        )
    scan = folder / "scan_calibration" / "LectureHall_lunge"
    (scan / "calibration").mkdir(parents=True)
    (folder / "scan_calibration" / "LectureHall_yoga").mkdir()
    for view, to_camera in VIEWS.items():
        numbers = " ".join(f"{v:.9f}" for v in to_camera[:3].ravel())
        intrinsics = " ".join(map(str, K.ravel()))
        (scan / "calibration" / f"{view:03d}.xml").write_text(
            f"<opencv_storage><CameraMatrix><data>{numbers}</data></CameraMatrix><Intrinsics><data>{intrinsics}</data>"
            "</Intrinsics><Distortion><data>-0.01 0.02 0 0 0</data></Distortion></opencv_storage>"
        )
        picture = (
            folder / "images" / "test" / SEQUENCE / f"cam_{view:02d}" / f"00042_{view:02d}.png"
        )
        picture.parent.mkdir(parents=True)
        Image.new("RGB", (640, 480)).save(picture)
    trimesh.creation.box((8, 0.1, 8)).apply_translation([0, 1.5, 3]).export(
        scan / "scan_camcoord.ply"
    )
    (folder / "resource").mkdir()
    (folder / "resource" / "gender.json").write_text(json.dumps({"9": "male", "21": "neutral"}))
    return folder


def true_people(root, files, view):
    """Vertices (2, 10475, 3) and joints (2, 22, 3) in a camera."""
    genders = ("male", "neutral")
    both = [files.bodies.pose_smplx(parameters_of(row), one) for row, one in enumerate(genders)]
    vertices, joints = (moved_by(VIEWS[view], np.stack(part)) for part in zip(*both, strict=True))
    return vertices, joints[:, :22]


def test_errors_and_contact_on_another_mesh(root, files, tmp_path):
    truth = np.zeros(6890, bool)
    truth[:100] = True
    behind = np.array([0, 0, 0.05])
    for view in VIEWS:
        vertices, joints = (part[::-1] + behind for part in true_people(root, files, view))
        write_plain(
            tmp_path / "theirs",
            f"{SEQUENCE}/00042/{view}",
            vertices=vertices,
            joints=joints,
            joint_names=np.array(JOINT_NAMES[:22]),
            contact=np.stack([files.bodies.transfer_contact(truth, "smpl", "smplx")] * 2),
        )
    arguments = ["rich", str(root), "-o", str(tmp_path / "out"), *files.arguments()]
    done = run(*arguments, "--results", f"theirs=plain:{tmp_path / 'theirs'}")
    assert done.exit_code == 0, done.output
    values = figures(tmp_path / "out", "theirs")
    assert values["found"] == 1
    assert (values["me_mpjpe"], values["me_pve"]) == pytest.approx((50, 50), abs=0.01)
    assert values["recall@annotated"] > 0.7  # carried to 10475 vertices and back
    assert values["precision@annotated"] > 0.7


def test_each_camera_has_its_view(root, files):
    frames = DATA_SET.frames(root, FrameChoice(), files.bodies, "test").frames
    assert [frame.id for frame in frames] == [f"{SEQUENCE}/00042/{view}" for view in VIEWS]
    truth = frames[1].truth()
    assert frames[1].camera.distortion == (-0.01, 0.02, 0, 0, 0)
    np.testing.assert_allclose(
        truth.people[0].vertices, true_people(root, files, 3)[0][0], atol=1e-4
    )
