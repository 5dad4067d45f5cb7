"""How segmenters get masks wrong: ragged borders, a hand or a foot left out, a bit of something else taken in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_mock.noise import chance, pixels_of, ragged

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.worlds import World

__all__ = ["LIMB_ENDS", "floor_mask", "with_strays", "without_ends"]

LIMB_ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")
"""Joints at which hands and feet begin."""

_HAND_RADIUS_M = 0.06  # round the joints of the fingers
_FOOT_RADIUS_M = 0.09  # round the line from ankle to toes


def without_ends(
    mask: BoolArray, world: World, person: int, share: float, noise: float, rng: np.random.Generator
) -> BoolArray:
    """The mask (H, W) without each hand and foot that is missed, of a ``share`` of them times ``noise``."""
    missed = chance(share, noise, rng.random(len(LIMB_ENDS)))
    if not missed.any():
        return mask.copy()
    rows, columns = np.nonzero(mask)
    points = world.points(people=True)[rows, columns].astype(np.float64)
    kept = mask.copy()
    for name in np.array(LIMB_ENDS)[missed]:
        beads, radius = _beads(world.joints[person].astype(np.float64), str(name))
        near = np.linalg.norm(points[:, None] - beads, axis=2).min(axis=1) < radius
        kept[rows[near], columns[near]] = False
    return kept


def _beads(joints: FloatArray, end: str) -> tuple[FloatArray, float]:
    """Points (M, 3) along a hand or a foot, and how far its skin is from them."""
    side, _, name = end.partition("_")
    if name == "wrist":
        first = JOINT_INDEX[f"{side}_index1"]
        knuckles = joints[first : first + 15]
        return np.concatenate([(joints[[JOINT_INDEX[end]]] + knuckles) / 2, knuckles]), _HAND_RADIUS_M
    ankle, foot = joints[JOINT_INDEX[end]], joints[JOINT_INDEX[f"{side}_foot"]]
    return ankle + np.linspace(-0.3, 1.7, 7)[:, None] * (foot - ankle), _FOOT_RADIUS_M


def with_strays(mask: BoolArray, size_px: float, share: float, noise: float, rng: np.random.Generator) -> BoolArray:
    """The mask (H, W), now and then with a disc of what is beside it, about a twentieth of ``size_px`` in radius."""
    happens, radius, pick = chance(share, noise, rng.random(1))[0], size_px * rng.uniform(0.03, 0.07), rng.random()
    return mask | _disc_on_border(mask, radius, pick) if happens else mask.copy()


def floor_mask(floor: BoolArray, ragged_px: float, spills: float, noise: float, rng: np.random.Generator) -> BoolArray:
    """A floor (H, W) with a ragged border, bits of walls and furniture taken in and bits of floor left out.

    Args:
        floor: true pixels.
        ragged_px: how far the border strays.
        spills: mean number of bits taken in, and of bits left out; times ``noise``.
        noise: factor.
        rng: draws.
    """
    rough = ragged(floor, ragged_px, rng)
    counts, picks = rng.random((2, 8)), rng.random((2, 8))
    radii = pixels_of(1.0, floor.shape) * rng.uniform(8, 30, (2, 8))
    happens = chance(spills / 8, noise, counts)
    for takes_in in (True, False):
        for i in np.flatnonzero(happens[int(takes_in)]):
            bit = _disc_on_border(floor, radii[int(takes_in), i], picks[int(takes_in), i])
            rough = rough | bit if takes_in else rough & ~bit
    return rough


def _disc_on_border(mask: BoolArray, radius: float, pick: float) -> BoolArray:
    """A disc (H, W) about one of the mask's border pixels; ``pick`` in [0, 1) says which. Nothing without a border."""
    import cv2

    border = np.argwhere(mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0))
    if not len(border):
        return np.zeros_like(mask)
    row, column = border[int(pick * len(border))]
    v, u = np.ogrid[: mask.shape[0], : mask.shape[1]]
    disc: BoolArray = (v - row) ** 2 + (u - column) ** 2 <= radius**2
    return disc
