from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physic_core.body import load_body
from physic_core.interfaces import HandEstimator
from physic_core.types import SKELETONS, Keypoints, People
from physic_core.types.skeletons import other_side
from physic_embedded.body_fit.fingers import RestHand, fit_fingers
from physic_embedded.hand_estimator import EmbeddedHands, EmbeddedHandsOptions
from physic_embedded.networks.blazepose import BLAZEPOSE_SKELETON
from physic_testing import violations

HAND_JOINTS = {"left": slice(25, 40), "right": slice(40, 55)}
FLAT = np.zeros((15, 3))


@pytest.fixture(scope="module")
def body():
    return load_body().to(dtype=torch.float64)


def posed(body, side, rotvecs=FLAT, root=Rotation.identity(), betas=0.0):  # noqa: B008
    """(21, 3) landmarks of a hand with given finger rotations."""
    rotations, shape, transl = body.zero_pose()
    rotations[0, HAND_JOINTS[side]] = torch.from_numpy(Rotation.from_rotvec(rotvecs).as_matrix())
    rotations[0, 0] = torch.from_numpy(root.as_matrix())
    out = body(rotations, shape + betas, transl)
    return body.landmarks(out, f"openpose_hand21_{side}")[0].numpy()


def rest_of(body, side):
    return RestHand.from_landmarks(posed(body, side), np.array([0.0, -1.0, 0.0]))


def curled(rest, degrees, spread=0.0):
    """All fingers but the thumb bent by the same angle in every joint, index and pinky spread
    apart.
    """
    out = np.zeros((5, 3, 3))
    out[:4] = np.radians(degrees) * rest.axes[:4, :, 0]
    out[[0, 2], 0] += np.radians(spread) * np.array([[1.0], [-1.0]]) * rest.axes[[0, 2], 0, 1]
    return out.reshape(15, 3)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(("degrees", "spread"), [(0.0, 0.0), (25.0, 8.0), (60.0, 0.0)])
def test_a_hand_pose_is_recovered_from_its_landmarks(body, side, degrees, spread):
    rest = rest_of(body, side)
    truth = curled(rest, degrees, spread)
    root = Rotation.from_rotvec([0.4, -1.1, 2.0])
    # Another shape and another unit: only directions count.
    seen = 1.3 * posed(body, side, truth, root, betas=0.5)
    found = fit_fingers(seen, rest)
    turned = Rotation.from_rotvec(found) * Rotation.from_rotvec(truth).inv()
    moved = posed(body, side, found, root) - posed(body, side, truth, root)
    assert turned.magnitude().mean() < np.radians(4)
    assert np.linalg.norm(moved, axis=1).mean() < 0.003


def test_fingers_stay_within_the_range_of_human_joints(body):
    rest = rest_of(body, "right")
    backwards = posed(body, "right", curled(rest, -80.0))
    found = fit_fingers(backwards, rest).reshape(5, 3, 3)
    flexion = np.degrees((found[:4] * rest.axes[:4, :, 0]).sum(-1))
    assert (flexion[:, 0] > -30.1).all()
    assert (flexion[:, 1:] > -10.1).all()


def test_left_and_right_hands_are_mirror_images(body):
    left = rest_of(body, "left")
    right = rest_of(body, "right")
    mirror = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(left.bones * mirror, right.bones, atol=1e-3)
    # An axis of rotation turns the other way in a mirror.
    np.testing.assert_allclose(-left.axes[:, :, 0] * mirror, right.axes[:, :, 0], atol=2e-3)


def arm(image, skeleton=BLAZEPOSE_SKELETON, confidence=1.0):
    """One person with both arms somewhere in the middle of an image."""
    h, w = image.shape[:2]
    points = np.tile(np.array([w / 2, h / 2], np.float32), (1, len(skeleton), 1))
    points[0, :, 0] += np.linspace(-0.2 * w, 0.2 * w, points.shape[1])
    people = People(np.zeros((1, h, w), bool), np.zeros((1, 4), np.float32), np.ones(1, np.float32))
    return people, Keypoints(points, np.full(points.shape[:2], confidence, np.float32), skeleton)


@pytest.fixture(scope="module")
def estimator():
    backend = EmbeddedHands(EmbeddedHandsOptions(threads=1))
    backend.load()
    return backend


@pytest.mark.parametrize(
    "skeleton", [BLAZEPOSE_SKELETON, SKELETONS["coco17"], SKELETONS["coco17"].take(range(7))]
)
def test_no_hand_is_found_where_there_is_none(estimator, skeleton):
    image = np.full((200, 300, 3), 128, np.uint8)
    hands = estimator.infer(image, *arm(image, skeleton))
    assert violations(HandEstimator, hands, people=1) == []
    assert hands.confidence.max() == 0


RIGHT_ARM = {
    "left_shoulder": (423, 221),
    "right_shoulder": (342, 229),
    "left_hip": (417, 349),
    "right_hip": (370, 353),
    "right_elbow": (328, 303),
    "right_wrist": (318, 369),
}


def test_a_hand_of_the_example_is_found_and_mirrored_in_the_mirror_image(estimator, pytestconfig):
    photo = cv2.imread(str(pytestconfig.rootpath / "examples" / "couple.jpg"))[..., ::-1]
    image = cv2.resize(photo, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)

    def hands(image, points):
        people, unseen = arm(image, SKELETONS["coco17"], confidence=0.0)
        rows = [unseen.joint_set.names.index(name) for name in points]
        places, seen = unseen.points.copy(), unseen.confidence.copy()
        places[0, rows] = list(points.values())
        seen[0, rows] = 1
        return estimator.infer(image, people, replace(unseen, points=places, confidence=seen))

    found = hands(image, RIGHT_ARM)
    last = image.shape[1] - 1
    other = hands(
        np.ascontiguousarray(image[:, ::-1]),
        {other_side(name): (last - x, y) for name, (x, y) in RIGHT_ARM.items()},
    )
    assert found.confidence[0, 1] > 0.9 > 0 == found.confidence[0, 0]
    np.testing.assert_allclose(other.confidence[:, ::-1], found.confidence, atol=0.05)
    mirrored = other.rotvecs[:, ::-1] * [1, -1, -1]
    np.testing.assert_allclose(mirrored, found.rotvecs, atol=0.15)
