"""Mocks of the segmenter and the inpainter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.backends.people import boxes_from_masks
from physic_core.types import SURFACE_NAMES, People, SurfaceLabels
from physic_mock.fill import fill_from_surroundings
from physic_mock.mask_noise import add_stray_disc, draw_floor_mask, remove_hands_and_feet
from physic_mock.noise import Noise
from physic_mock.recognition import MockOptions, recognise_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array
    from physic_mock.recognition import RecognisedWorld


class SegmenterOptions(MockOptions):
    """Options of :class:`MockSegmenter`."""

    missed_people: interfaces.Share = Field(
        0.03,
        description="Share of people who are not found, times the noise; the largest in the photo "
        "always is.",
    )
    surfaces: bool = Field(
        False,
        description="Whether surfaces are labelled, without errors. The engine then also looks "
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
        found = recognise_world(image)
        noise = Noise(found.world, self.options)
        taken = np.zeros(image.shape[:2], bool)
        masks: list[BoolArray] = []
        for i in _found_people(found, noise, self.options):
            mask = _person(noise, i) & ~taken
            if mask.any():
                masks.append(mask)
                taken |= mask
        stacked = np.array(masks, bool).reshape(-1, *image.shape[:2])
        return People(
            masks=stacked,
            boxes=boxes_from_masks(stacked),
            scores=0.95 - 0.02 * np.arange(len(masks)),
            floor=_floor(found, noise),
            surfaces=_surfaces(found) if self.options.surfaces else None,
            heads=np.ones(len(masks), int),
        )


def _found_people(found: RecognisedWorld, noise: Noise, options: SegmenterOptions) -> list[int]:
    """Return the people that are present and not missed."""
    present = np.flatnonzero(found.present).tolist()
    draws = noise.rng("missed people").random(len(found.present))
    missed = noise.happens(options.missed_people, draws)
    sizes = found.world.masks.sum((1, 2))
    largest = max(present, key=lambda i: sizes[i], default=None)
    return [i for i in present if i == largest or not missed[i]]


def _person(noise: Noise, person: int) -> BoolArray:
    """Return the mask of one person with errors."""
    world = noise.world
    rng = noise.rng(f"mask of person {person}")
    x0, y0, x1, y1 = world.boxes[person]
    mask = noise.rough_border(world.masks[person], rng)
    whole = remove_hands_and_feet(mask, noise, person, rng)
    return add_stray_disc(whole, noise, max(x1 - x0, y1 - y0), rng)


def _floor(found: RecognisedWorld, noise: Noise) -> BoolArray | None:
    """Return the floor mask with errors; None if it is missed."""
    rng = noise.rng("floor mask")
    if noise.happens("missed floors", rng.random(1))[0]:
        return None
    seen = found.world.empty_floor_mask & ~found.people
    return draw_floor_mask(seen, noise, rng) & ~found.people


def _surfaces(found: RecognisedWorld) -> SurfaceLabels:
    """Return the true labels of the pixels."""
    person = SURFACE_NAMES.index("person")
    return SurfaceLabels(
        np.where(found.people, person, found.world.empty_surfaces).astype(np.uint8)
    )


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
