"""Evidence that people lie on the surface behind them, so that the camera looks down on it.

Behind a person who stands, the floor at the feet recedes, and what is behind the head is farther
away than the body. Around a person who lies, one plane is near the body from head to heel. Camera
frame, any unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.ground.posture import keypoints_by_side
from physic_core.geometry.inverse_depth import planes_through, weighted_plane
from physic_core.geometry.pixels import dilate_square, median
from physic_core.types.skeletons import SEEN_CONFIDENCE

if TYPE_CHECKING:
    from physic_core.engine.photo_content import PhotoContent

LYING_RATE = 0.05
"""Share of photos in which people lie beneath the camera."""

_SOFT = ("bed", "rug")
_WALL = ("wall", "window")
_RING = 0.08  # width of the background around a person, in lengths from shoulders to ankles
_SMALLEST = 0.15  # that length, in heights of the photo; depth maps do not resolve smaller people
_FEWEST = 30  # pixels of each part of that background, and of the body
_UPPER = 0.35  # of the way from shoulders to ankles: the background behind head and shoulders
_LOWER = 1.0  # beyond the ankles, where a person who stands has floor
_PARTS = ((-0.5, 0.1), (0.3, 0.6), (0.9, 1.3))  # of the body on that way
_TOLERANCE = 0.06  # of inverse depth on the plane, as a share
_HYPOTHESES = 400
_DRAWN = 1500  # pixels
_REFITS = 5

# Gap: logarithm of the depth of the plane over that of the body before it; half-normal if the body
# lies on it, exponential if not. Of 75 people who stand or sit in photos, all three gaps of none
# are below .25 where most of the background at head and feet is on the plane.
_GAP_LYING = 0.1  # sigma
_GAP_WRONG = 0.05  # share of people who lie and whose depth is wrong
_GAP_STANDING = 0.6  # mean
_FAR_OFF = 1.0  # larger gaps add no evidence
_LEAST_DENSITY = 0.1  # of the share on the plane
_MOST_NATS = 4.0  # of one person
_UNLABELLED = 0.3  # share of the background with the label of a bed or rug that doubles the odds
# Set on two photos of people who stand at walls, with shares of .9 to 1, and one of a bed.
_USUAL_WALL = 0.3  # share of the background with the label of a wall, around a bed seen from above
_WALL_NATS = 6.0  # price of all of the background beyond it


@dataclass(frozen=True)
class Background:
    """Background around one person from head to heel, and the depth of the body before it.

    Attributes:
        rows: (M,) int64, of the background's pixels.
        columns: (M,) int64.
        along: (M,) their places on the way from shoulders, 0, to ankles, 1, in the picture.
        soft_share: share of them with the label of a bed or rug.
        wall_share: share of them with the label of a wall or window.
        body_rays: rays (3, 3) to head, trunk and feet: the median pixels of the mask.
        body_depth: (3,) of these, in the unit of the scene.
    """

    rows: Tensor
    columns: Tensor
    along: Tensor
    soft_share: float
    wall_share: float
    body_rays: Tensor
    body_depth: Tensor


def people_backgrounds(photo: PhotoContent) -> tuple[Background, ...]:
    """Return the background around each person whose shoulders and ankles are seen."""
    soft, wall = (photo.labelled(*names) for names in (_SOFT, _WALL))
    points, confidence = keypoints_by_side(photo.keypoints, "shoulder", "ankle")
    ends = points.mean(2)
    visible = (confidence >= SEEN_CONFIDENCE).all((1, 2)) & np.isfinite(ends).all((1, 2))
    backgrounds = []
    for i in np.flatnonzero(visible).tolist():
        mask = photo.masks[i]
        start, end = torch.from_numpy(ends[i]).double()
        axis = end - start
        length = float(torch.linalg.vector_norm(axis))
        if length < _SMALLEST * mask.shape[0]:
            continue
        ring = dilate_square(mask, max(2, round(_RING * length))) & ~photo.hole
        rows, columns = ring.nonzero(as_tuple=True)
        body = (mask & photo.aligned_points.valid).nonzero()
        along = (body.flip(1) - start) @ axis / length**2
        sections = [body[(along > low) & (along < high)] for low, high in _PARTS]
        if min(len(rows), *map(len, sections)) < _FEWEST:
            continue
        section_points = torch.stack(
            [
                median(photo.aligned_points.points[section.unbind(1)].double())
                for section in sections
            ]
        )
        backgrounds.append(
            Background(
                rows,
                columns,
                (torch.stack([columns, rows], 1) - start) @ axis / length**2,
                float(soft[ring].double().mean()),
                float(wall[ring].double().mean()),
                section_points / section_points[:, 2:],
                section_points[:, 2],
            )
        )
    return tuple(backgrounds)


def plane_beneath_lying_people(
    rays: Tensor, inverse: Tensor, people: tuple[Background, ...]
) -> tuple[Tensor | None, float]:
    """Return the plane (3,) in inverse depth by ray on which people lie more probably than on
    others, and the log odds that they do, nats; None without evidence.

    Args:
        rays: (H, W, 3) of the scene without people.
        inverse: (H, W) inverse depth, 0 where unknown.
        people: their people_backgrounds.
    """
    best: tuple[Tensor | None, float] = None, -math.inf
    for person in people:
        plane = _background_plane(rays, inverse, person)
        if plane is not None:
            nats = sum(_lying_nats(rays, inverse, other, plane) for other in people)
            best = max(
                best, (plane, math.log(LYING_RATE / (1 - LYING_RATE)) + nats), key=itemgetter(1)
            )
    return best


def _background_plane(rays: Tensor, inverse: Tensor, person: Background) -> Tensor | None:
    """Return the plane (3,) on which most of the background around a person lies."""
    near = inverse[person.rows, person.columns].double()
    is_known = near > 0
    near = near[is_known]
    ray = rays[person.rows, person.columns].double()[is_known]
    if len(near) < _FEWEST:
        return None
    step = max(1, len(near) // _DRAWN)
    near = near[::step]
    ray = ray[::step]
    drawn = torch.randint(len(near), (_HYPOTHESES, 3), generator=torch.Generator().manual_seed(0))
    planes = planes_through(ray, near, drawn)
    if not len(planes):
        return None
    share = (planes @ ray.T / near - 1) / _TOLERANCE
    plane: Tensor = planes[(1 - share.square()).clamp(min=0).sum(1).argmax()]
    for _ in range(_REFITS):
        error = (ray @ plane / near - 1) / _TOLERANCE
        refitted = weighted_plane(ray, near, ((1 - error.square()).clamp(min=0) / near).square())
        if refitted is None:
            break
        plane = refitted
    return plane


def _lying_nats(rays: Tensor, inverse: Tensor, person: Background, plane: Tensor) -> float:
    """Return the log likelihood ratio of a person who lies on a plane to one who does not."""
    near = inverse[person.rows, person.columns].double()
    on_plane = rays[person.rows, person.columns].double() @ plane
    on = ((on_plane / near - 1).abs() < _TOLERANCE) & (near > 0)
    ends = [on[person.along < _UPPER], on[person.along > _LOWER]]
    share = min(float(end.double().mean()) if len(end) else 0.0 for end in ends)
    plane_depth = person.body_rays @ plane
    if not (plane_depth > 0).all():
        return -_MOST_NATS
    gap = min(float((plane_depth * person.body_depth).log().abs().max()), _FAR_OFF)
    lying = (1 - _GAP_WRONG) * math.sqrt(2 / math.pi) / _GAP_LYING
    lying = lying * math.exp(-0.5 * (gap / _GAP_LYING) ** 2) + _GAP_WRONG
    nats = math.log(lying * _GAP_STANDING) + gap / _GAP_STANDING
    # Beta(4, 1) of people who lie, Beta(1, 3) of others
    nats += math.log(max(4 * share**3, _LEAST_DENSITY) / max(3 * (1 - share) ** 2, _LEAST_DENSITY))
    nats = min(max(nats + math.log(1 + person.soft_share / _UNLABELLED), -_MOST_NATS), _MOST_NATS)
    return nats - _WALL_NATS * max(0.0, person.wall_share - _USUAL_WALL)
