"""What a photo shows of people whose joints are known."""

from __future__ import annotations

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_core.types import skeleton_named
from physic_scene.observations import COLOUR_GROUPS, PhotoPeople

SMALL = np.array([[100.0, 0.0, 59.5], [0.0, 100.0, 44.5], [0.0, 0.0, 1.0]])
"""Camera of a photo of 120 x 90 px."""


def photo(joints, K=SMALL, focal_sigma=0.1, size_px=45.0):
    """Return people in like clothes with joints (N, 55, 3), and the keypoints of a camera."""
    n = len(joints)
    skeleton = skeleton_named("coco17")
    landmarks = joints[:, [JOINT_INDEX.get(name, JOINT_INDEX["head"]) for name in skeleton.names]]
    pixels = landmarks @ K.T
    return PhotoPeople(
        K=K,
        focal_sigma=focal_sigma,
        skeleton=skeleton,
        points=pixels[..., :2] / pixels[..., 2:],
        confidence=np.ones(landmarks.shape[:2]),
        landmarks=landmarks,
        joints=joints,
        rotations=np.zeros((n, 55, 3, 3)),
        betas=np.zeros((n, 10)),
        stature=np.full(n, 1.75),
        colours=np.full((n, len(COLOUR_GROUPS), 3), 40.0),
        size_px=np.full(n, size_px),
        up=np.full(3, np.nan),
        known_stature=np.full(n, np.nan),
    )
