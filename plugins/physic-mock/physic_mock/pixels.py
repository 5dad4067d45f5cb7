"""Mocks of the segmenter and the inpainter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import SURFACE_NAMES, People, SurfaceLabels
from physic_mock.fill import fill_from_surroundings
from physic_mock.mask_noise import add_stray_disc, draw_floor_mask, remove_hands_and_feet
from physic_mock.noise import bernoulli, roughen_border, scale_to_image, seeded_rng
from physic_mock.recognition import MockOptions, recognise_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_mock.recognition import RecognisedWorld


_RAGGED_PX = 1.2  # how far the masks' borders stray, of a photo 640 px wide
_MISSED_ENDS = 0.04  # share of hands and feet that the masks miss
_STRAYS = 0.15  # share of people whose mask takes in a bit of what is beside them
_MISSED_FLOORS = 0.22  # share of photos whose floor is not found
_SPILLS = 1.5  # mean number of bits of other things in the floor's mask, and of bits that it lacks


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
        taken = np.zeros(image.shape[:2], bool)
        masks: list[BoolArray] = []
        for i in _found_people(found, self.options):
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
            surfaces=_surfaces(found) if self.options.surfaces else None,
            heads=np.ones(len(masks), int),
        )


def _found_people(found: RecognisedWorld, options: SegmenterOptions) -> list[int]:
    """Return the people that are present and not missed."""
    present = [int(i) for i in np.flatnonzero(found.present)]
    if not present:
        return []
    largest = max(present, key=lambda i: np.count_nonzero(found.world.masks[i]))
    draws = seeded_rng(found.world, options.noise_seed, "missed people").random(len(found.present))
    missed = bernoulli(options.missed_people, options.noise, draws)
    return [i for i in present if i == largest or not missed[i]]


def _person(found: RecognisedWorld, person: int, options: SegmenterOptions) -> BoolArray:
    """Return the mask of one person with errors."""
    world = found.world
    noise = options.noise
    rng = seeded_rng(world, options.noise_seed, f"mask of person {person}")
    x0, y0, x1, y1 = world.boxes[person]
    mask = roughen_border(
        world.masks[person], noise * scale_to_image(_RAGGED_PX, found.people.shape), rng
    )
    whole = remove_hands_and_feet(mask, world, person, _MISSED_ENDS, noise, rng)
    return add_stray_disc(whole, max(x1 - x0, y1 - y0), _STRAYS, noise, rng)


def _floor(found: RecognisedWorld, options: SegmenterOptions) -> BoolArray | None:
    """Return the floor mask with errors; None if it is missed."""
    rng = seeded_rng(found.world, options.noise_seed, "floor mask")
    if bernoulli(_MISSED_FLOORS, options.noise, rng.random(1))[0]:
        return None
    seen = found.world.empty_floor_mask & ~found.people
    stray = options.noise * scale_to_image(_RAGGED_PX, seen.shape)
    return draw_floor_mask(seen, stray, _SPILLS, options.noise, rng) & ~found.people


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


def _box(mask: BoolArray) -> FloatArray:
    """Return the tight box x0 y0 x1 y1 of a mask, end exclusive."""
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)
