"""Ground beside what carries people in the picture: beside the soles of those who stand, and right
below the lowest skin of those who lie, plank or kneel on all fours.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.ground.floor import GroundAtSoles
from physic_core.engine.ground.stance import Stance
from physic_core.engine.limbs import lowest_layer, observed_parts
from physic_core.engine.photo_content import FEWEST_PIXELS
from physic_core.geometry.tensors import exact_arrays
from physic_core.types.arrays import select_people
from physic_core.types.observations import TOUCH_PARTS
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from physic_core.body.model import BodyModel
    from physic_core.engine.photo_content import PhotoContent
    from physic_core.geometry.floor import PlaneFit
    from physic_core.types import BoolArray, FloatArray, Keypoints

RAISED_SURFACES = ("seat", "bed", "table", "cabinet", "vehicle")
"""Surfaces that can carry people above the ground."""

_BESIDE_SOLES = 0.12  # of the height of a person's mask: reach of the ground beside soles
_BESIDE_SOLES_PHOTO = 0.02  # of the photo's long side, added to it
_FORESHORTENED = 0.6  # height over width of the window
_RESTS = 0.9  # probability that people who lie do so on the ground below them
_RESTS_AMONG_RAISED = 0.4  # the same above what can carry people
_BELOW = 0.05  # of the diagonal of a person's mask: reach of the ground below it
_MOST_FEET = 0.5  # share of feet in the lowest skin of who does not stand on them
_DRAWN = 5  # one of as many vertices is followed into the picture


class LowSkin(NamedTuple):
    """Skin of N people some of whom may rest on any part of it.

    Attributes:
        may_rest: (N,) bool, who does; the others stand on their feet.
        vertices: (N, V, 3) metres.
        skin: (N, V) bool, outer skin of the trunk and of limbs in sight.
    """

    may_rest: BoolArray
    vertices: Tensor
    skin: Tensor

    def lowest_vertices(self, person: int, up: Tensor) -> Tensor:
        """Return the lowest vertices (V,) bool of a person by a unit vector (3,)."""
        return lowest_layer(self.vertices[person] @ up.to(self.vertices), self.skin[person])

    def lowest_limbs(self, model: BodyModel, up: Tensor) -> BoolArray:
        """Return which left and right feet, and hands, in sight or not, are as low (N, 4); none of
        people whose trunk is.
        """
        is_low = np.zeros((len(self.may_rest), 4), bool)
        limb_masks = [model.part_mask(name) for name in TOUCH_PARTS[:4]]
        trunk = model.part_mask("torso")
        for i in np.flatnonzero(self.may_rest).tolist():
            layer = self.lowest_vertices(i, up)
            height = self.vertices[i] @ up.to(self.vertices)
            top = height[layer].amax()
            if not layer[trunk].any():
                is_low[i] = [bool(height[part].amin() <= top) for part in limb_masks]
        return is_low

    def scales_on_floor(self, floor: PlaneFit) -> FloatArray:
        """Return the scale (N,), metres per unit of a floor, that puts the lowest skin on it; NaN
        for people who stand, and where it is not positive.
        """
        scales = np.full(len(self.may_rest), np.nan)
        for i in np.flatnonzero(self.may_rest).tolist():
            rests = self.vertices[i][self.lowest_vertices(i, floor.normal)]
            lowest = -float((rests @ floor.normal.to(self.vertices)).amin())
            scales[i] = lowest / floor.offset if lowest > 0 else np.nan
        return scales

    def lowest_pixels(self, person: int, up: Tensor, matrix: FloatArray) -> FloatArray:
        """Return where the lowest skin of a person is in the picture (M, 2) px.

        Args:
            person: row.
            up: (3,) unit.
            matrix: (3, 3) px of the camera.
        """
        (points,) = exact_arrays(self.vertices[person][self.lowest_vertices(person, up)][::_DRAWN])
        points = points @ matrix.T
        return points[:, :2] / points[:, 2:]


def low_skin(
    may_rest: BoolArray,
    vertices: Tensor,
    model: BodyModel,
    observed: BoolArray,
    holds: BoolArray,
    up: Tensor,
) -> LowSkin:
    """Return the skin of N people who may rest on it, unless most of the lowest is that of feet;
    without hands that hold something, which may be a bar over the floor.

    Args:
        may_rest: (N,) who may rest on any part.
        vertices: (N, V, 3) metres.
        model: of the bodies.
        observed: (N, 55) bool, visible joints.
        holds: (N, 2) left and right hand.
        up: (3,) unit.
    """
    visible_parts = observed_parts(model.part_names, torch.from_numpy(observed))
    for side, held in zip(SIDES, holds.T, strict=True):
        visible_parts[:, model.part_names.index(f"{side}_hand")] &= ~torch.from_numpy(held)
    people_skin = LowSkin(
        may_rest.copy(), vertices, visible_parts[:, model.part_of_vertex] & model.outer
    )
    feet = model.part_mask("foot")
    for i in np.flatnonzero(may_rest).tolist():
        whole = bool(torch.isfinite(vertices[i]).all()) and bool(people_skin.skin[i].any())
        people_skin.may_rest[i] = (
            whole and float(feet[people_skin.lowest_vertices(i, up)].double().mean()) < _MOST_FEET
        )
    return people_skin


def ground_at_soles(
    photo: PhotoContent, low_skin_of_people: LowSkin | None = None, up: Tensor | None = None
) -> tuple[GroundAtSoles, ...]:
    """Return the visible ground beside the soles of each person, if the photo shows it; below the
    lowest skin of those who rest on it.

    Args:
        photo: of N people.
        low: their skin; None before bodies are known.
        up: (3,) unit, with ``low``.
    """
    raised = photo.labelled(*RAISED_SURFACES)
    on_feet = 1 - (1 - Stance.in_picture(photo.observations).stand_probability).prod(1)
    grounds = []
    for i in range(len(photo.people)):
        rests = (
            low_skin_of_people is not None
            and up is not None
            and bool(low_skin_of_people.may_rest[i])
        )
        if low_skin_of_people is not None and up is not None and rests:
            window = _pixels_below(
                photo, i, low_skin_of_people.lowest_pixels(i, up, photo.camera.matrix)
            )
        else:
            window = _pixels_at_soles(photo, i)
        ground = (window & ~photo.hole).nonzero()
        if len(ground) >= FEWEST_PIXELS:
            pixels = ground[:, 0], ground[:, 1]
            stand_probability = float(on_feet[i])
            if rests:
                among_raised = float(raised[pixels].double().mean()) > 0.5
                stand_probability = _RESTS_AMONG_RAISED if among_raised else _RESTS
            grounds.append(
                GroundAtSoles(*pixels, stand_probability, float(photo.people.scores[i]), i)
            )
    return tuple(grounds)


def _pixels_at_soles(photo: PhotoContent, person: int) -> Tensor:
    """Return the pixels (H, W) bool around heels and toes."""
    height, width = photo.hole.shape
    size = float(photo.masks[person].any(1).sum())
    reach = _BESIDE_SOLES * size + _BESIDE_SOLES_PHOTO * max(height, width)
    window = torch.zeros_like(photo.hole)
    for x, y in feet_pixels(select_people(photo.keypoints, np.array([person])), height, width):
        flat = _FORESHORTENED * reach
        rows = slice(max(0, round(y - flat)), round(y + flat) + 1)
        window[rows, max(0, round(x - reach)) : round(x + reach) + 1] = True
    return window


def _pixels_below(photo: PhotoContent, person: int, points: FloatArray) -> Tensor:
    """Return the nearest pixels (H, W) bool in sight right below places (M, 2) px of a person."""
    window = torch.zeros_like(photo.hole)
    height, width = window.shape
    mask = photo.masks[person]
    reach = max(1, round(_BELOW * math.hypot(int(mask.any(0).sum()), int(mask.any(1).sum()))))
    for x, y in _pixels_inside(points, height, width):
        column = (~photo.hole[y : y + 3 * reach, x]).nonzero()[:reach, 0]
        window[y + column, x] = True
    return window


def _pixels_inside(points: FloatArray, height: int, width: int) -> Iterator[tuple[int, int]]:
    for x, y in np.unique(np.rint(points).astype(int), axis=0).tolist():
        if 0 <= x < width and 0 <= y < height:
            yield x, y


def feet_pixels(
    keypoints: Keypoints, height: int, width: int, confidence: float = 0.5
) -> FloatArray:
    """Return heels and toes inside the image with more than ``confidence``, (M, 2) px."""
    soles = [
        i
        for i, name in enumerate(keypoints.joint_set.names)
        if name.endswith(("heel", "toe", "foot_tip"))
    ]
    points = keypoints.points[:, soles]
    visible = keypoints.confidence[:, soles] > confidence
    visible &= (
        (points >= 0).all(-1) & (points[..., 0] <= width - 1) & (points[..., 1] <= height - 1)
    )
    return points[visible]
