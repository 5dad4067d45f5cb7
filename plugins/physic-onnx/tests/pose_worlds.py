"""What perfect networks of one person would say of a photo; by the formulas of their own projects,
not by ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import affine_transform

from physic_core.body import JOINT_INDEX
from physic_core.types import SKELETONS, People
from physic_testing.conformance.true_keypoints import world_keypoints

if TYPE_CHECKING:
    pass

MEAN = np.array([0.485, 0.456, 0.406])
STD = np.array([0.229, 0.224, 0.225])


def standing(box, count):
    """(J, 2): joints of somebody of whom nothing is known, spread over the box."""
    share = (np.arange(count) + 0.5) / count
    return box[:2] + np.stack([0.3 + 0.4 * share, share], -1) * (box[2:] - box[:2])


def whose(world, box):
    """Row of the world's person with this box; None where it is nobody's."""
    apart = np.abs(world.boxes - box).max(axis=1)
    return int(apart.argmin()) if apart.min() < 2 else None


def joints(world, box, skeleton):
    """Places (J, 2) px of the photo and confidences (J,) of the person in a box."""
    count = len(SKELETONS[skeleton].names)
    row = None if world is None else whose(world, box)
    if world is None or row is None:
        return standing(box, count), np.full(count, 0.4)
    points, visible = world_keypoints(world, skeleton)
    return points[row], np.where(visible[row], 0.9, 0.3)


def depths(world, box, skeleton):
    """Metres (J,) by which the joints of the person in a box are farther than the middle of the
    hips.
    """
    count = len(SKELETONS[skeleton].names)
    row = None if world is None else whose(world, box)
    if world is None or row is None:
        return np.zeros(count)
    found = np.zeros(count)
    hips = world.joints[row, [1, 2], 2].mean()
    for joint, name in enumerate(SKELETONS[skeleton].names):
        if name in JOINT_INDEX:
            found[joint] = world.joints[row, JOINT_INDEX[name], 2] - hips
    return found


def region(box, width, height, padding=1.25):
    """MMPose's centre and scale of a box, in coordinates whose integers are pixel centres."""
    centre = (box[:2] + box[2:]) / 2 - 0.5
    w, h = np.maximum(box[2:] - box[:2], 1)
    w, h = (w, w * height / width) if w * height > h * width else (h * width / height, h)
    return centre, np.array([w, h]) * padding


def normalised(pixels):
    """(h, w, 3) 0..255 RGB -> (3, h, w)."""
    return ((pixels / 255 - MEAN) / STD).transpose(2, 0, 1)


def sampled(photo, origin, step, width, height):
    """(height, width, 3) where pixel (u, v) is the photo at origin + step * (u, v), bilinear; zero
    outside of it.
    """
    how = {"output_shape": (height, width), "order": 1, "mode": "grid-constant"}
    channels = [
        affine_transform(photo[..., c].astype(float), step[::-1], origin[::-1], **how)
        for c in range(3)
    ]
    return np.stack(channels, -1)


PLACES = [(90.0, 60.0), (120.0, 110.0), (75.0, 150.0)]
BOX = (50.0, 20.0, 150.0, 180.0)


def people(*boxes, size=(200, 260)):
    """People with these boxes, in a photo of this height and width."""
    return People(
        np.zeros((len(boxes), *size), bool),
        np.array(boxes, float).reshape(-1, 4),
        np.ones(len(boxes)),
    )


def blobs(places, size=(200, 260), sigma=9.0):
    """A photo with a red, a green and a blue blob."""
    y, x = np.mgrid[: size[0], : size[1]]
    apart = [(x - u) ** 2 + (y - v) ** 2 for u, v in places]
    return np.stack([255 * np.exp(-square / (2 * sigma**2)) for square in apart], -1).astype(
        np.uint8
    )
