"""The lifter alone: limbs (N, 12, 3) in the axes of a camera that looks at the person."""

from __future__ import annotations

import numpy as np
import pytest

from physic_embedded.body_fit.lifter import HIPS, LimbView, predict_joints
from physic_embedded.body_fit.limb_keypoints import LIMBS

MIRROR = np.array([-1.0, 1.0, 1.0])
SWAPPED = [row ^ 1 for row in range(len(LIMBS))]
DEPTH = 4.0
# A walker who faces the camera, metres: x right in the picture, y down, z away; left limbs first.
WALKER = np.array(
    [
        *([0.17, -0.46, 0.02], [-0.17, -0.46, -0.02]),
        *([0.22, -0.21, 0.06], [-0.23, -0.22, -0.03]),
        *([0.23, -0.02, -0.06], [-0.24, -0.04, -0.16]),
        *([0.11, 0.0, 0.0], [-0.11, 0.0, 0.0]),
        *([0.12, 0.36, -0.12], [-0.12, 0.37, 0.06]),
        *([0.12, 0.78, -0.04], [-0.12, 0.74, 0.28]),
    ]
)


def seen(joints):
    """Keypoints (N, 12, 2) on the plane of the hips of a perfect detector."""
    return joints[..., :2] * DEPTH / (DEPTH + joints[..., 2:])


def told(joints, points, up=(0.0, -1.0, 0.0), depth=DEPTH):
    count = len(joints)
    sure = np.full((count, len(LIMBS)), 0.95)
    return predict_joints(
        LimbView(joints, points, sure, np.tile(up, (count, 1)), np.full(count, depth))
    )


def leaning(degrees):
    """The walker as a fit makes it that leans towards the camera: same height in the picture."""
    angle = np.radians(degrees)
    turned = WALKER.copy()
    turned[:, 2] = WALKER[:, 2] + np.tan(angle) * WALKER[:, 1]
    return turned[None]


def test_a_mirror_image_is_lifted_to_the_mirror_image_and_one_person_as_several():
    joints = leaning(8.0) + np.random.default_rng(0).normal(0, 0.03, (5, len(LIMBS), 3))
    points = seen(WALKER[None]) + np.zeros((5, 1, 1))
    alone = told(joints, points, up=(0.1, -0.9, 0.3))
    mirrored = told(
        (joints * MIRROR)[:, SWAPPED], (points * MIRROR[:2])[:, SWAPPED], up=(-0.1, -0.9, 0.3)
    )
    np.testing.assert_allclose((mirrored * MIRROR)[:, SWAPPED], alone, atol=1e-12)
    one = told(joints[:1], points[:1], up=(0.1, -0.9, 0.3))
    np.testing.assert_allclose(one, alone[:1], atol=1e-12)


@pytest.mark.parametrize(
    ("degrees", "up", "share"), [(-15.0, -1.0, 0.75), (15.0, -1.0, 0.75), (15.0, 0.0, 1.0)]
)
def test_a_body_that_leans_in_depth_is_lifted_nearer_to_the_truth(degrees, up, share):
    """Least if up is unknown, a vector of zero."""
    joints = leaning(degrees)
    found = told(joints, seen(WALKER[None]), up=(0.0, up, 0.0))
    before, after = (np.linalg.norm(one - WALKER, axis=-1).mean() for one in (joints, found))
    assert after < share * before
    np.testing.assert_allclose(found[:, HIPS].mean(1), 0, atol=1e-12)


@pytest.mark.parametrize(("depth", "least", "most"), [(-0.08, 0.0, 0.05), (-0.22, 0.11, 0.23)])
def test_a_forearm_is_told_flat_where_its_tilt_is_a_guess(depth, least, most):
    joints = WALKER.copy()
    elbow, wrist = LIMBS.index("left_elbow"), LIMBS.index("left_wrist")
    joints[wrist] = joints[elbow] + [0.0, np.sqrt(0.23**2 - depth**2), depth]
    found = told(joints[None], seen(joints[None]))[0]
    assert least < found[elbow, 2] - found[wrist, 2] < most
