"""``benchmarks/truth/estimators``: what is known of a photo, in px of the picture that the estimators got."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from physic_evaluate import cameras, triangulation
from physic_evaluate import joints as joints_by_name

FOLDER = Path(__file__).parents[2] / "benchmarks" / "truth"
NAME = "truth_benchmark_of_estimators"


@pytest.fixture(scope="module")
def truth() -> Iterator[SimpleNamespace]:
    """The modules of the package, under a name of their own: ``benchmarks`` is no package that is installed."""
    spec = importlib.util.spec_from_file_location(
        NAME, FOLDER / "__init__.py", submodule_search_locations=[str(FOLDER)]
    )
    assert spec is not None
    sys.modules[NAME] = importlib.util.module_from_spec(spec)
    names = ("sets", "scores", "estimators")
    shared = {"cameras": cameras, "joints": joints_by_name, "views": triangulation}
    yield SimpleNamespace(**shared, **{name: importlib.import_module(f"{NAME}.{name}") for name in names})
    for name in [name for name in sys.modules if name.split(".")[0] == NAME]:
        del sys.modules[name]


JOINTS = {
    "l_shoulder": (0.2, -0.5, 3.0),
    "r_shoulder": (-0.2, -0.5, 3.1),
    "l_elbow": (0.25, -0.2, 3.0),
    "r_elbow": (-0.25, -0.2, 3.0),
    "l_wrist": (0.3, 0.05, 2.9),
    "r_wrist": (-0.3, 0.05, 2.8),
    "l_hip": (0.1, 0.0, 3.0),
    "r_hip": (-0.1, 0.0, 3.0),
    "l_knee": (0.1, 0.45, 2.95),
    "r_knee": (-0.1, 0.45, 2.95),
    "l_ankle": (0.1, 0.9, 3.0),
    "r_ankle": (-0.1, 0.9, 3.0),
}
K = np.array([[1000.0, 0, 500], [0, 1000, 400], [0, 0, 1]])


def estimates_of(width: int, height: int, points: np.ndarray | None = None) -> SimpleNamespace:
    """Estimates of a picture of this size, with keypoints (N, 12, 2) in the order of LIMB_JOINTS."""
    from physic_testing.bench.estimator_errors import LIMB_JOINTS

    points = np.zeros((0, 12, 2)) if points is None else points
    keypoints = SimpleNamespace(
        joint_set=SimpleNamespace(names=LIMB_JOINTS), points=points, confidence=np.ones(points.shape[:2])
    )
    return SimpleNamespace(image=np.zeros((height, width, 3), np.uint8), keypoints=keypoints)


def test_points_are_those_of_the_picture_that_was_made_smaller(truth):
    record = {"joints": JOINTS, "K": K.tolist(), "width": 1000, "height": 800, "up": [0, -1, 0]}
    sample = truth.sets.Sample("mpi_inf_3dhp", "a", "a", Path(), K=K, truth=record | {"floor_point": [0, 1.5, 3]})
    found = truth.estimators.single_truth(sample, estimates_of(500, 400))
    row = truth.joints.ROW["left_hip"]
    assert found.points[0, row] == pytest.approx([(500 + 100 / 3 + 0.5) / 2 - 0.5, 199.75])
    assert found.camera_height == pytest.approx(1.5)
    assert np.isnan(found.seen).all()


def test_what_is_hidden_is_unknown_where_a_data_set_does_not_say_so(truth, monkeypatch):
    monkeypatch.setattr(truth.estimators, "picture_of", lambda sample: np.zeros((200, 100, 3), np.uint8))
    marks = {name: [10.0, 20.0, 1.0] for name in JOINTS} | {"l_knee": [11.0, 30.0, 2.0], "r_knee": [0.0, 0.0, 0.0]}
    person = {"keypoints": marks, "box_xywh": [0, 0, 50, 100]}
    seen = {}
    for name in ("coco", "posetrack18"):
        sample = truth.sets.Sample("people2d", "a", "a", Path(), truth={"set": name, "people": [person]})
        seen[name] = truth.estimators.annotated_truth(sample, estimates_of(100, 200))
    row = truth.joints.ROW
    assert seen["coco"].seen[0, [row["left_knee"], row["left_hip"]]].tolist() == [1, 0]
    assert np.isnan(seen["coco"].points[0, row["right_knee"]]).all()
    assert np.isnan(seen["posetrack18"].seen).all()


def test_a_view_is_compared_with_the_triangulation_of_the_others(truth):
    joints = truth.joints.limb_joints(JOINTS, 3)
    views = []
    for k, angle in enumerate(np.radians([-40, -15, 10, 35])):
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        camera = truth.cameras.Camera(K, 1000, 800, turn, np.array([0, 0, 3.0]) - turn @ np.array([0, 0, 3.0]))
        points = camera.project(joints)[None]
        if k == 0:
            points = points + np.array([0, 12.0])
        known = {"camera": camera, "up": np.array([0.0, -1.0, 0.0])}
        sample = truth.sets.Sample("panoptic", f"view{k}", "0", Path(), K=K, truth=known)
        views.append((sample, estimates_of(1000, 800, points)))
    first = next(iter(truth.estimators.moment_truth(views)))
    assert first[0].name == "view0"
    assert first[2].points[0] == pytest.approx(views[0][1].keypoints.points[0] - [0, 12], abs=1e-6)
    assert first[2].joints[0] == pytest.approx(views[0][0].truth["camera"].in_camera(joints), abs=1e-6)
    assert first[2].camera_height == pytest.approx(0, abs=1e-9)


def test_who_touches_in_a_film_has_joints_in_a_frame_of_their_own(truth):
    points = np.zeros((2, 12, 2))
    estimates = estimates_of(100, 100, points)
    estimates.people = SimpleNamespace(boxes=np.array([[0, 0, 10, 10], [0, 0, 50, 50]]))
    limbs = dict.fromkeys(("l_ankle", "r_ankle", "l_fingers", "r_fingers"), False)
    known = {"joints": JOINTS, "touches": limbs | {"l_ankle": True}, "uncaptured": limbs | {"r_fingers": True}}
    found = truth.estimators.parkour_truth(truth.sets.Sample("parkour", "a", "a", Path(), truth=known), estimates)
    assert found.touches == ({"left_foot": True, "right_foot": False, "left_hand": False},)
    assert (found.camera_known, found.points_known) == (False, False)
    assert found.boxes.tolist() == [[0, 0, 50, 50]]
