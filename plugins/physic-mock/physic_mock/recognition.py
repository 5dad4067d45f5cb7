"""Which world a photo shows. A mock that does not know the photo says so: it must never pass for a real estimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.errors import BackendError
from physic_testing.worlds import WORLDS, World, build_world, labels

if TYPE_CHECKING:
    from physic_core.types import BoolArray, People, UInt8Array

__all__ = ["MockOptions", "Recognised", "match_people", "recognise"]

_TOLERANCE = 2  # grey levels; a world drawn on another machine may round differently
_LARGEST_PX = 1920 * 1440  # a larger world would take minutes to draw
_SAME_PERSON_IOU = 0.3


class MockOptions(interfaces.Options):
    """Settings that all mocks share."""

    noise: float = Field(
        1.0, ge=0, le=10, description="Factor on all errors of this backend; 0 is the truth, 2 twice the errors."
    )
    noise_seed: int = Field(0, ge=0, description="Seed of this mock's own errors.")


@dataclass(frozen=True)
class Recognised:
    """A world found in an image.

    Attributes:
        world: the world.
        people: (H, W) bool, pixels where a person of the world is still seen.
        present: (N,) bool, people of whom more than half of the pixels are seen.
    """

    world: World
    people: BoolArray
    present: BoolArray


def recognise(image: UInt8Array, hole: BoolArray | None = None) -> Recognised:
    """Find the world whose photo this is, with all, some or none of its people taken out.

    Args:
        image: (H, W, 3) uint8, with the label of its world in its corners.
        hole: (H, W) bool, pixels that an inpainter made up and that are not compared.

    Raises:
        BackendError: it is the photo of no world.
    """
    height, width = image.shape[:2]
    label = labels.read(image)
    if label is None:
        raise _refusal(width, height, "carries no world's label")
    name, seed = label
    if name not in WORLDS:
        raise _refusal(width, height, f"is of the world {name!r}, which there is not")
    if height * width > _LARGEST_PX:
        raise _refusal(width, height, f"is larger than worlds are drawn ({_LARGEST_PX} px in all)")
    world = build_world(name, seed, (width, height))
    photo, empty = _alike(image, world.image), _alike(image, world.empty_image)
    explained = photo | empty if hole is None else photo | empty | hole
    if not explained.all():
        raise _refusal(
            width, height, f"differs from the world {name!r}, seed {seed}, in {1 - explained.mean():.1%} of its pixels"
        )
    return _who_is_left(world, photo if hole is None else photo & ~hole, empty)


def _refusal(width: int, height: int, fault: str) -> BackendError:
    return BackendError(
        f"The mock backends only know the photos of their own worlds, and this {width} x {height} px image {fault}: "
        "give physic_testing.worlds.build_world(name, seed, size).image, saved without loss, "
        "or choose real backends."
    )


def _who_is_left(world: World, photo: BoolArray, empty: BoolArray) -> Recognised:
    # Where a person has the colour of what is behind them, a pixel belongs to them if most of their others do.
    people: BoolArray = photo & ~empty & world.masks.any(axis=0)
    present = np.zeros(len(world.masks), bool)
    telling = ~_alike(world.image, world.empty_image)
    for i, mask in enumerate(world.masks):
        present[i] = (people & mask & telling).sum() > 0.5 * (mask & telling).sum()
    for mask in world.masks[present]:
        people = people | (photo & mask)
    return Recognised(world, people, present)


def match_people(recognised: Recognised, people: People) -> list[int]:
    """Which person of the world each given person is.

    Raises:
        BackendError: one of them is nobody of the world.
    """
    rows: list[int] = []
    for i, mask in enumerate(people.masks):
        overlaps = [
            -1.0 if j in rows else np.count_nonzero(mask & own) / np.count_nonzero(mask | own)
            for j, own in enumerate(recognised.world.masks)
        ]
        best = int(np.argmax(overlaps))
        if overlaps[best] < _SAME_PERSON_IOU:
            raise BackendError(
                f"Person {i} is nobody of the mock world {recognised.world.name!r}: their mask overlaps no remaining "
                f"person by an IoU of {_SAME_PERSON_IOU} or more (best {max(overlaps[best], 0.0):.2f}). "
                "Use masks of the people in the photo."
            )
        rows.append(best)
    return rows


def _alike(a: UInt8Array, b: UInt8Array) -> BoolArray:
    difference = np.abs(a.astype(np.int16) - b.astype(np.int16))
    alike: BoolArray = difference.max(axis=2) <= _TOLERANCE
    return alike
