"""Numbers of people in pictures: where they stand, and their discs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_visual.panels import draw_person_number
from physic_visual.render import View

if TYPE_CHECKING:
    from PIL import ImageDraw

    from physic_core.types import Reconstruction

_Box = tuple[float, float, float, float]

_HEAD = JOINT_INDEX["head"]
_NECK = JOINT_INDEX["neck"]
_DISC_PX = 12.0
# Where a number goes whose place is taken, in radii of its disc, the nearest first.
_STEPS = sorted(
    ((column, row) for column in range(-8, 9) for row in range(-4, 9)),
    key=lambda step: math.hypot(*step),
)


def heads_in_photo(
    reconstruction: Reconstruction, width: int, height: int
) -> dict[int, tuple[float, float]]:
    """Return column and row above the head of each person of the photo, or beside it at the top
    edge, in a picture of a size in px.
    """
    camera = View.perspective(reconstruction.intrinsics, width, height)
    heads = {}
    for index, person in enumerate(reconstruction.people):
        spots = camera.project(np.asarray(person.joints[[_HEAD, _NECK]], np.float64))
        column, row = spots[0, :2]
        top = float(person.box[1]) * height / reconstruction.image.shape[0] - 14
        if not person.mask.any() or not np.isfinite([column, row, top]).all():
            continue
        if top < 12:
            aside = max(28.0, 1.6 * float(np.linalg.norm(spots[0, :2] - spots[1, :2])))
            column = column + (aside if column + aside < width - 12 else -aside)
            top = max(row - 6, 12)
        heads[index] = (float(column), float(top))
    return heads


def draw_numbers(
    pen: ImageDraw.ImageDraw,
    corner: tuple[float, float],
    centers: Mapping[int, tuple[float, float]],
    size: tuple[int, int],
    occupied_boxes: Sequence[_Box] = (),
) -> None:
    """Draw the numbers of people inside a picture, none over another or over what is taken.

    Args:
        pen: of the page.
        corner: upper left corner of the picture, px of the page.
        centers: person -> column and row in the picture.
        size: of the picture, px.
        occupied_boxes: boxes x0, y0, x1, y1 in the picture that stay free.
    """
    used = list(occupied_boxes)
    for index, center in centers.items():
        x, y = (
            float(np.clip(value, _DISC_PX, side - _DISC_PX))
            for value, side in zip(center, size, strict=True)
        )
        spots = [(x + column * _DISC_PX, y + row * _DISC_PX) for column, row in _STEPS]
        inside = [
            spot
            for spot in spots
            if all(_DISC_PX <= at <= side - _DISC_PX for at, side in zip(spot, size, strict=True))
        ]
        x, y = next(
            (spot for spot in inside if not any(_overlaps_box(spot, box) for box in used)), (x, y)
        )
        used.append((x - _DISC_PX, y - _DISC_PX, x + _DISC_PX, y + _DISC_PX))
        draw_person_number(pen, corner[0] + x, corner[1] + y, index)


def _overlaps_box(spot: tuple[float, float], box: _Box) -> bool:
    """Return whether the disc of a number at a spot reaches into a box."""
    x, y = spot
    return box[0] - _DISC_PX < x < box[2] + _DISC_PX and box[1] - _DISC_PX < y < box[3] + _DISC_PX
