"""Mocks of the segmenter and the inpainter, and errors of masks: rough borders, missing hands and
feet, added pixels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.backends.people import boxes_from_masks
from physic_core.body import JOINT_INDEX
from physic_core.types import SURFACE_NAMES, People, SurfaceLabels
from physic_mock.fill import fill_from_surroundings
from physic_mock.noise import Noise, scale_to_image
from physic_mock.recognition import MockOptions, recognise_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_mock.recognition import RecognisedWorld


class SegmenterOptions(MockOptions):
    """Options of :class:`MockSegmenter`."""

    missed_people: interfaces.Share = Field(
        0.03,
        description="Share of people who are not found, times the noise; the largest person "
        "is always found.",
    )
    surfaces: bool = Field(
        False,
        description="Whether surfaces are labeled, without errors. The engine then also looks "
        "for feet in the air, "
        "which it finds too often among the errors of depth of the other mocks.",
    )


class MockSegmenter(interfaces.Segmenter):
    """Segmenter that returns a world's person masks and floor mask with errors."""

    written_for = 1
    Options = SegmenterOptions
    options: SegmenterOptions

    def infer(self, image: UInt8Array) -> People:
        """Return the people that are still visible in a world's photo.

        Raises:
            BackendError: the image shows no world.
        """
        recognised = recognise_world(image)
        noise = Noise(recognised.world, self.options)
        taken = np.zeros(image.shape[:2], bool)
        masks: list[BoolArray] = []
        for i in _found_people(recognised, noise, self.options):
            mask = _person_mask(noise, i) & ~taken
            if mask.any():
                masks.append(mask)
                taken |= mask
        stacked = np.array(masks, bool).reshape(-1, *image.shape[:2])
        return People(
            masks=stacked,
            boxes=boxes_from_masks(stacked),
            scores=0.95 - 0.02 * np.arange(len(masks)),
            floor=_floor_mask(recognised, noise),
            surfaces=_surfaces(recognised) if self.options.surfaces else None,
            heads=np.ones(len(masks), int),
        )


def _found_people(
    recognised: RecognisedWorld, noise: Noise, options: SegmenterOptions
) -> list[int]:
    """Return the people that are present and not missed."""
    present = np.flatnonzero(recognised.present_people).tolist()
    draws = noise.rng("missed people").random(len(recognised.present_people))
    missed = noise.draw_is_below(options.missed_people, draws)
    sizes = recognised.world.masks.sum((1, 2))
    largest = max(present, key=lambda i: sizes[i], default=None)
    return [i for i in present if i == largest or not missed[i]]


def _person_mask(noise: Noise, person: int) -> BoolArray:
    """Return the mask of one person with errors: a rough border, without some hands and feet, and
    for some people with a disc at the border.
    """
    world = noise.world
    rng = noise.rng(f"mask of person {person}")
    x0, y0, x1, y1 = world.boxes[person]
    rough = noise.rough_border(world.masks[person], rng)
    mask = _without_limb_ends(rough, noise, person, rng)
    strays = noise.draw_is_below("strays", rng.random(1))[0]
    radius = max(x1 - x0, y1 - y0) * rng.uniform(0.03, 0.07)
    pick = rng.random()
    return mask | _disc_on_border(mask, radius, pick) if strays else mask


def _floor_mask(recognised: RecognisedWorld, noise: Noise) -> BoolArray | None:
    """Return the floor mask with a rough border, false patches and missing ones; None if it is
    missed.
    """
    rng = noise.rng("floor mask")
    if noise.draw_is_below("missed floors", rng.random(1))[0]:
        return None
    visible_floor = recognised.world.empty_floor_mask & ~recognised.people_pixels
    rough = noise.rough_border(visible_floor, rng)
    draw_is_below = noise.draw_is_below("spills", rng.random((2, 8)))
    picks = rng.random((2, 8))
    radii = scale_to_image(1.0, visible_floor.shape) * rng.uniform(8, 30, (2, 8))
    for takes_in in (1, 0):
        for i in np.flatnonzero(draw_is_below[takes_in]):
            bit = _disc_on_border(visible_floor, radii[takes_in, i], picks[takes_in, i])
            rough = rough | bit if takes_in else rough & ~bit
    return rough & ~recognised.people_pixels


def _surfaces(recognised: RecognisedWorld) -> SurfaceLabels:
    """Return the true labels of the pixels."""
    person = SURFACE_NAMES.index("person")
    return SurfaceLabels(
        np.where(recognised.people_pixels, person, recognised.world.empty_surfaces).astype(np.uint8)
    )


_LIMB_ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")
"""Joints at the start of hands and feet."""

_HAND_RADIUS_M = 0.06  # round the joints of the fingers
_FOOT_RADIUS_M = 0.09  # round the line from ankle to toes


def _without_limb_ends(
    mask: BoolArray, noise: Noise, person: int, rng: np.random.Generator
) -> BoolArray:
    """Return the mask (H, W) of a person without some hands and feet."""
    missed = noise.draw_is_below("missed ends", rng.random(len(_LIMB_ENDS)))
    if not missed.any():
        return mask
    rows, columns = np.nonzero(mask)
    points = noise.world.points(people=True)[rows, columns].astype(np.float64)
    kept = mask.copy()
    for name in np.array(_LIMB_ENDS)[missed]:
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


class MockInpainter(interfaces.Inpainter):
    """Inpainter that fills the mask with a world's image without people, or, with noise, from what
    surrounds it.

    The other mocks read the world instead of the image.
    """

    written_for = 1
    Options = MockOptions
    options: MockOptions

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Return the image with filled masked pixels; other pixels are unchanged.

        Raises:
            BackendError: the image shows no world.
        """
        filled: UInt8Array = image.copy()
        world = recognise_world(image).world
        if self.options.noise > 0:
            around = fill_from_surroundings(image.astype(np.float64), mask)[mask]
            filled[mask] = np.rint(around).astype(np.uint8)
        else:
            filled[mask] = world.empty_image[mask]
        return filled
