"""Mocks of what is seen in the image: masks, and the picture without people."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import People
from physic_mock.mask_noise import floor_mask, with_strays, without_ends
from physic_mock.noise import chance, generator, pixels_of, ragged
from physic_mock.recognition import MockOptions, recognise

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_mock.recognition import Recognised

__all__ = ["MockInpainter", "MockSegmenter", "SegmenterOptions"]


class SegmenterOptions(MockOptions):
    """Settings of :class:`MockSegmenter`."""

    raggedness_px: float = Field(
        1.2, ge=0, le=20, description="How far the masks' borders stray, px of a photo 640 px wide."
    )
    missed_ends: float = Field(0.04, ge=0, le=1, description="Share of hands and feet that are left out of the masks.")
    strays: float = Field(
        0.15, ge=0, le=1, description="Share of people whose mask takes in a bit of what is beside them."
    )
    floor: bool = Field(True, description="Whether the floor is looked for; false answers None.")
    floor_missed: float = Field(0.15, ge=0, le=1, description="Share of photos whose floor is not found.")
    floor_spills: float = Field(
        1.5,
        ge=0,
        le=8,
        description="Mean number of bits of other things in the floor's mask, and of bits of floor left out.",
    )


class MockSegmenter(interfaces.Segmenter):
    """The world's visible masks and its floor, ragged, with bits missing and bits too many."""

    Options = SegmenterOptions

    def infer(self, image: UInt8Array) -> People:
        """Image (H, W, 3) of a world -> the people still in it.

        Raises:
            BackendError: the image shows no world.
        """
        assert isinstance(self.options, SegmenterOptions)
        found = recognise(image)
        taken = np.zeros(image.shape[:2], bool)
        masks: list[BoolArray] = []
        for i in np.flatnonzero(found.present):
            stray = _person(found, int(i), self.options) & ~taken
            if stray.any():
                masks.append(stray)
                taken |= stray
        scores = 0.95 - 0.02 * np.arange(len(masks))
        return People(
            masks=np.stack(masks) if masks else np.zeros((0, *image.shape[:2]), bool),
            boxes=np.array([_box(mask) for mask in masks]).reshape(-1, 4),
            scores=scores,
            floor=_floor(found, self.options),
        )


def _person(found: Recognised, person: int, options: SegmenterOptions) -> BoolArray:
    world, noise = found.world, options.noise
    rng = generator(world, options.noise_seed, f"mask of person {person}")
    x0, y0, x1, y1 = world.boxes[person]
    mask = ragged(world.masks[person], noise * pixels_of(options.raggedness_px, found.people.shape), rng)
    whole = without_ends(mask, world, person, options.missed_ends, noise, rng)
    return with_strays(whole, max(x1 - x0, y1 - y0), options.strays, noise, rng)


def _floor(found: Recognised, options: SegmenterOptions) -> BoolArray | None:
    rng = generator(found.world, options.noise_seed, "floor mask")
    if chance(options.floor_missed, options.noise, rng.random(1))[0] or not options.floor:
        return None
    seen = found.world.empty_floor_mask & ~found.people
    stray = options.noise * pixels_of(options.raggedness_px, seen.shape)
    return floor_mask(seen, stray, options.floor_spills, options.noise, rng) & ~found.people


class MockInpainter(interfaces.Inpainter):
    """The world's own picture without people, in the hole: the one mock without errors.

    All other mocks read the world and not the picture, so what an inpainter makes up shows in the point map's
    ``hole_noise`` and ``disagreement``.
    """

    Options = MockOptions

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Image (H, W, 3) of a world, mask (H, W) -> image; unchanged where the mask is False, shadows included.

        Raises:
            BackendError: the image shows no world.
        """
        filled: UInt8Array = image.copy()
        filled[mask] = recognise(image).world.empty_image[mask]
        return filled


def _box(mask: BoolArray) -> FloatArray:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)
