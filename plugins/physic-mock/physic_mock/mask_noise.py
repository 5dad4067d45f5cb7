"""Errors of person and floor masks: rough borders, missing hands and feet, added pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_mock.noise import Noise, scale_to_image

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

LIMB_ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")
"""Joints at the start of hands and feet."""

_HAND_RADIUS_M = 0.06  # round the joints of the fingers
_FOOT_RADIUS_M = 0.09  # round the line from ankle to toes


def remove_hands_and_feet(
    mask: BoolArray, noise: Noise, person: int, rng: np.random.Generator
) -> BoolArray:
    """Return the mask (H, W) of a person without some hands and feet."""
    missed = noise.happens("missed ends", rng.random(len(LIMB_ENDS)))
    if not missed.any():
        return mask.copy()
    rows, columns = np.nonzero(mask)
    points = noise.world.points(people=True)[rows, columns].astype(np.float64)
    kept = mask.copy()
    for name in np.array(LIMB_ENDS)[missed]:
        beads, radius = _limb_end_points(noise.world.joints[person].astype(np.float64), str(name))
        near = np.linalg.norm(points[:, None] - beads, axis=2).min(axis=1) < radius
        kept[rows[near], columns[near]] = False
    return kept


def _limb_end_points(joints: FloatArray, end: str) -> tuple[FloatArray, float]:
    """Return points (M, 3) along a hand or a foot, and the radius of its skin."""
    side, _, name = end.partition("_")
    if name == "wrist":
        first = JOINT_INDEX[f"{side}_index1"]
        knuckles = joints[first : first + 15]
        return np.concatenate(
            [(joints[[JOINT_INDEX[end]]] + knuckles) / 2, knuckles]
        ), _HAND_RADIUS_M
    ankle = joints[JOINT_INDEX[end]]
    foot = joints[JOINT_INDEX[f"{side}_foot"]]
    return ankle + np.linspace(-0.3, 1.7, 7)[:, None] * (foot - ankle), _FOOT_RADIUS_M


def add_stray_disc(
    mask: BoolArray, noise: Noise, size_px: float, rng: np.random.Generator
) -> BoolArray:
    """Return the mask (H, W) of a person, some with a disc at the border."""
    happens = noise.happens("strays", rng.random(1))[0]
    radius = size_px * rng.uniform(0.03, 0.07)
    pick = rng.random()
    return mask | _disc_on_border(mask, radius, pick) if happens else mask.copy()


def draw_floor_mask(floor: BoolArray, noise: Noise, rng: np.random.Generator) -> BoolArray:
    """Return a floor mask (H, W) with a rough border, false patches and missing patches."""
    rough = noise.rough_border(floor, rng)
    counts = rng.random((2, 8))
    picks = rng.random((2, 8))
    radii = scale_to_image(1.0, floor.shape) * rng.uniform(8, 30, (2, 8))
    happens = noise.happens("spills", counts)
    for takes_in in (1, 0):
        for i in np.flatnonzero(happens[takes_in]):
            bit = _disc_on_border(floor, radii[takes_in, i], picks[takes_in, i])
            rough = rough | bit if takes_in else rough & ~bit
    return rough


def _disc_on_border(mask: BoolArray, radius: float, pick: float) -> BoolArray:
    """Return a disc (H, W) around the border pixel that ``pick`` in [0, 1) selects; empty without a
    border.
    """
    import cv2

    border = np.argwhere(mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0))
    if not len(border):
        return np.zeros_like(mask)
    row, column = border[int(pick * len(border))]
    v, u = np.ogrid[: mask.shape[0], : mask.shape[1]]
    disc: BoolArray = (v - row) ** 2 + (u - column) ** 2 <= radius**2
    return disc
