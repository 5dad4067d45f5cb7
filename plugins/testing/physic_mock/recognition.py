"""Recognition of the world in a photo. A mock raises BackendError for all other photos."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.errors import BackendError
from physic_mock import NOISE_VERSION
from physic_testing.worlds import WORLDS, World, labels, load_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, People, UInt8Array

_TOLERANCE = 2  # grey levels; photos that were scaled on another machine may round differently
_LARGEST_PX = 1920 * 1440  # of a photo, which is scaled from one of 640 x 480 px
_SAME_PERSON_IOU = 0.3


class MockOptions(interfaces.Options):
    """Options of all mocks."""

    noise: float = Field(
        0.0,
        ge=0,
        le=10,
        description="Factor on all errors of this backend: 0 is the truth, 1 has errors as large "
        "as those of the "
        "embedded estimators on real photos (noise version 4), 2 twice the errors.",
    )
    noise_seed: int = Field(0, ge=0, le=2**32 - 1, description="Seed of this mock's own errors.")

    @property
    def note_on_errors(self) -> str:
        """What a note says of the errors; empty without errors."""
        return (
            f" with errors of noise version {NOISE_VERSION} times {self.noise:g}"
            if self.noise
            else ""
        )


@dataclass(frozen=True)
class RecognisedWorld:
    """World found in an image.

    Attributes:
        world: the world.
        people_pixels: (H, W) bool, pixels in which a person of the world is visible.
        item_pixels: (K, H, W) bool, pixels in which each small object is visible.
        present_people: (N,) bool, people with more than half of their pixels visible.
    """

    world: World
    people_pixels: BoolArray
    item_pixels: BoolArray
    present_people: BoolArray


def recognise_world(image: UInt8Array, hole: BoolArray | None = None) -> RecognisedWorld:
    """Find the world of a photo from which all, some or none of the people are removed.

    Args:
        image: (H, W, 3) uint8, with the label of its world in its corners.
        hole: (H, W) bool, inpainted pixels, which are not compared.

    Raises:
        BackendError: the image is not the photo of a world.
    """
    height, width = image.shape[:2]
    name = labels.read_label(image)
    if not name:
        raise _unknown_image_error(width, height, "carries no world's label")
    if name not in WORLDS:
        raise _unknown_image_error(width, height, f"is of the world {name!r}, which does not exist")
    if height * width > _LARGEST_PX:
        raise _unknown_image_error(
            width, height, f"is larger than mocks accept ({_LARGEST_PX} px in all)"
        )
    world = load_world(name, (width, height))
    photo = _similar_pixels(image, world.image)
    empty = _similar_pixels(image, world.empty_image)
    explained = photo | empty if hole is None else photo | empty | hole
    if not explained.all():
        raise _unknown_image_error(
            width,
            height,
            f"differs from the world {name!r} in {1 - explained.mean():.1%} of its pixels",
        )
    shown = np.ones_like(photo) if hole is None else ~hole
    return _find_remaining(world, photo & shown, empty, shown)


def _unknown_image_error(width: int, height: int, fault: str) -> BackendError:
    """Return the error for an image that is not the photo of a world."""
    return BackendError(
        f"The mock backends only know the photos of their own worlds, and this {width} x {height} "
        f"px image {fault}: give physic_testing.worlds.load_world(name, size).image, saved without "
        "loss, or choose real backends."
    )


def _find_remaining(
    world: World, photo: BoolArray, empty: BoolArray, shown: BoolArray
) -> RecognisedWorld:
    """Find the people and the small objects that are still visible in the pixels ``shown`` of the
    photo.
    """
    # Where a person has the colour of what is behind them, a pixel belongs to them if most of their
    # others do.
    people: BoolArray = photo & ~empty & world.masks.any(axis=0)
    present = np.zeros(len(world.masks), bool)
    telling = ~_similar_pixels(world.image, world.empty_image)
    for i, mask in enumerate(world.masks):
        present[i] = (people & mask & telling).sum() > 0.5 * (mask & telling).sum()
    for mask in world.masks[present]:
        people = people | (photo & mask)
    items = np.zeros_like(world.item_masks)
    for k, mask in enumerate(world.item_masks):
        if (photo & ~empty & mask).sum() > 0.5 * (telling & mask & shown).sum():
            items[k] = photo & mask
    return RecognisedWorld(world, people, items, present)


def match_masks_to_world(recognised: RecognisedWorld, people: People) -> list[int]:
    """Return the index of the world's person for each input mask.

    Raises:
        BackendError: one of them is not in the world.
    """
    rows: list[int] = []
    for i, mask in enumerate(people.masks):
        overlaps = [
            -1.0
            if j in rows
            else np.count_nonzero(mask & true_mask) / np.count_nonzero(mask | true_mask)
            for j, true_mask in enumerate(recognised.world.masks)
        ]
        best = int(np.argmax(overlaps))
        if overlaps[best] < _SAME_PERSON_IOU:
            raise BackendError(
                f"Person {i} is nobody of the mock world {recognised.world.name!r}: their mask "
                f"overlaps no remaining person by an IoU of {_SAME_PERSON_IOU} or more (best "
                f"{max(overlaps[best], 0.0):.2f}). Use masks of the people in the photo."
            )
        rows.append(best)
    return rows


def _similar_pixels(a: UInt8Array, b: UInt8Array) -> BoolArray:
    """Return the pixels (H, W) bool in which two images agree up to rounding."""
    difference = np.abs(a.astype(np.int16) - b.astype(np.int16))
    alike: BoolArray = difference.max(axis=2) <= _TOLERANCE
    return alike
