"""Sizes that the user knows, measured on people and scene. OpenCV camera frame, metres."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.scene_state import SceneState
from physic_core.engine.sizes.evidence import FACTOR_SPREAD, ScaleEvidence, combined_scale
from physic_core.geometry.camera import project
from physic_core.geometry.visibility import facing_camera
from physic_core.types import KnownSizes
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.geometry.floor import PlaneFit
    from physic_core.types import FloatArray

_NEIGHBOURS = 4  # vertices that give the depth of a body at a pixel
_FACING_DEG = 89.0
_ON_SCENE = -1  # the row of no person: an end of a distance on the scene
_LEFT_OUT = -2  # the new row of a person who is not selected

PointFollower: TypeAlias = Callable[[Tensor], Tensor]
"""Point (3,) of a body at a pixel, on its ray, by the vertices (V, 3) of the body; differentiable.
"""


def point_follower(vertices: Tensor, normals: Tensor, ray: Tensor, K: Tensor) -> PointFollower:
    """Choose the vertices of a body (V, 3) with normals (V, 3) that give its depth at a pixel's ray
    (3,) with z = 1: its point there is at the weighted mean depth of the nearest visible ones.
    """
    facing = facing_camera(normals, vertices, _FACING_DEG)
    facing = facing if facing.any() else torch.ones_like(facing)
    away = (project(vertices, K) - project(ray[None], K)).square().sum(-1)
    away = torch.where(facing, away, torch.inf)
    nearest, ids = away.topk(min(_NEIGHBOURS, int(facing.sum())), largest=False)
    # A vertex of a limb behind can project between those of the limb in front.
    front = vertices[ids, 2] < vertices[ids, 2].amin() + 0.1
    weight = front / (nearest + 0.25)
    weight = weight / weight.sum()
    return lambda body: ray * (body[ids, 2] @ weight)


def size_factors(
    vertices: Tensor,
    soles: Tensor,
    soles_on_floor: Sequence[bool],
    floor: PlaneFit | None,
    points: Sequence[Tensor],
) -> Tensor:
    """Return the factor (B,) by which people must be enlarged to stand in the scene as the photo
    shows them.

    The photo shows the direction of each body, so that its size follows from its depth: that of the
    floor under visible soles, else that of the person's points. Points of people are too far away
    by a common share, which the people on the floor show. NaN where nothing is known.

    Args:
        vertices: (B, V, 3), each body where the photo shows it.
        soles: (S,) int64, vertices of the soles.
        soles_on_floor: of B people, whether the soles are seen on the floor.
        floor: of the scene, or None.
        points: of B people, (n, 3) each.
    """
    by_floor, by_points = (torch.full_like(vertices[:, 0, 0], torch.nan) for _ in range(2))
    for i, body in enumerate(vertices):
        if floor is not None and soles_on_floor[i]:
            drop = -(body[soles] @ floor.normal.to(body)).amin()
            by_floor[i] = floor.offset / drop if bool(drop > 0) else torch.nan
        if len(points[i]):
            by_points[i] = points[i][:, 2].median().to(body) / body[:, 2].median()
    too_far = (by_points / by_floor).nanmedian().nan_to_num(nan=1.0)
    return torch.where(torch.isfinite(by_floor), by_floor, by_points / too_far)


def size_beside_others(
    before: FloatArray, after: FloatArray, sigma: FloatArray, person: int
) -> tuple[float, float]:
    """Return the log size of a person as the photo shows it beside the others, and its standard
    deviation.

    The joint fit divides a contradiction between all people. So the photo shows a person as large
    as the result, less the growth of the others, weighed by their errors.

    Args:
        before: (N,) log sizes before the fit.
        after: (N,) log sizes by the fit, NaN where unknown.
        sigma: (N,) expected errors of ``before``.
        person: row.
    """
    weight = np.delete(np.where(np.isfinite(after), 1 / (sigma**2 + FACTOR_SPREAD**2), 0.0), person)
    spread = sigma[person] ** 2 + FACTOR_SPREAD**2
    if not weight.sum():
        return float(after[person]), float(np.sqrt(spread))
    common = np.average(np.delete(np.nan_to_num(after - before), person), weights=weight)
    return float(after[person] - common), float(np.sqrt(spread + 1 / weight.sum()))


BodyEnds = tuple[PointFollower | None, ...]
"""Points of the two ends of a distance on bodies; None for an end on the scene."""


@dataclass(frozen=True)
class LocatedDistances(ShortRepr):
    """L known distances between two points each.

    Attributes:
        metres: (L,).
        person: (L, 2) int64, person under each pixel, or -1 for the scene.
        points: (L, 2, 3) metres, scene points at the pixels; NaN on a person.
        rays: (L, 2, 3) viewing rays of the pixels with z = 1.
        index: (L,) int64, position among the given lengths.
    """

    metres: Tensor
    person: Tensor
    points: Tensor
    rays: Tensor
    index: Tensor

    def ends_on_bodies(self, vertices: Tensor, normals: Tensor, K: Tensor) -> list[BodyEnds]:
        """Choose, for each distance, the points of its ends on bodies (B, V, 3) with normals (B, V,
        3).
        """
        return [
            tuple(
                point_follower(vertices[person], normals[person], ray, K) if person >= 0 else None
                for person, ray in zip(people, rays, strict=True)
            )
            for people, rays in zip(self.person.tolist(), self.rays, strict=True)
        ]

    def measure(
        self, ends: Sequence[BodyEnds], vertices: Tensor, scale: Tensor | float
    ) -> list[Tensor]:
        """Return the distances, metres, between people with vertices (B, V, 3) in a scene at a
        scale; differentiable.

        Args:
            ends: of :meth:`ends_on_bodies`.
            vertices: (B, V, 3).
            scale: factor on the points of the scene.
        """
        lengths = []
        for i, on_bodies in enumerate(ends):
            start, end = (
                self.points[i, side] * scale if on is None else on(vertices[person])
                for side, (on, person) in enumerate(
                    zip(on_bodies, self.person[i].tolist(), strict=True)
                )
            )
            lengths.append(torch.linalg.vector_norm(start - end))
        return lengths

    def __getitem__(self, rows: Tensor) -> LocatedDistances:
        return LocatedDistances(*(getattr(self, each.name)[rows] for each in fields(self)))


@dataclass(frozen=True)
class LocatedSizes(ShortRepr):
    """Known sizes of B people and their scene, all in metres.

    Attributes:
        stature: (B,), NaN where unknown.
        camera_height: over the floor, or None.
        distances: between points of the scene or of people.
        depth_sigma: error of log(scale) of a measured depth that gave the scale, or None.
        unused: per given length without a point at one of its pixels, its position.
        unscaled: the scene before it got the size that these sizes give it; None if none gives it,
            and nothing was scaled.
        factor: on that scene.
        scale_sigma: standard deviation of the logarithm of the factor.
    """

    stature: Tensor
    camera_height: float | None
    distances: LocatedDistances
    unused: tuple[int, ...] = ()
    depth_sigma: float | None = None
    unscaled: SceneState | None = None
    factor: float = 1.0
    scale_sigma: float | None = None

    def select_people(self, rows: Tensor) -> LocatedSizes:
        """Return the sizes of a selection of the people, (n,) int64; distances on other people are
        skipped.
        """
        new_row = torch.full((len(self.stature) + 1,), _LEFT_OUT)
        new_row[rows] = torch.arange(len(rows))
        new_row[_ON_SCENE] = _ON_SCENE  # the index -1 finds the slot behind the last person
        person = new_row[self.distances.person]
        distances = replace(self.distances, person=person)[(person != _LEFT_OUT).all(1)]
        return replace(self, stature=self.stature[rows], distances=distances)


def scale_scene_to_known_sizes(
    known: KnownSizes,
    stature: Sequence[float],
    masks: Tensor,
    scene: SceneState,
    by_depth: ScaleEvidence | None = None,
) -> tuple[SceneState, LocatedSizes]:
    """Scale the scene to known sizes, if they give its scale.

    The camera height and each length whose ends are both on the scene are evidence of it.

    Args:
        known: pixels in px of the image.
        stature: (B,) metres, NaN where unknown.
        masks: (B, H, W) bool. A pixel in a mask is on that person, the smallest one where masks
            overlap.
        scene: stage 1.
        by_depth: of the factor on the scene by a measured depth, or None.
    """
    located = _located_sizes(known, stature, masks, scene)
    evidence = []
    if by_depth is not None:
        located = replace(located, depth_sigma=by_depth.sigma)
        evidence.append(by_depth)
    if known.camera_height is not None and scene.floor is not None:
        evidence.append(ScaleEvidence.by_known_size(known.camera_height, scene.floor.offset))
    d = located.distances
    on_scene = (d.person == _ON_SCENE).all(1)
    extent = torch.linalg.vector_norm(d.points[on_scene, 0] - d.points[on_scene, 1], dim=-1)
    known_and_shown = zip(d.metres[on_scene].tolist(), extent.clamp(min=1e-6).tolist(), strict=True)
    evidence += [ScaleEvidence.by_known_size(metres, length) for metres, length in known_and_shown]
    scale = combined_scale(evidence)
    if scale is None:
        return scene, located
    return scale_scene(scene, replace(located, scale_sigma=scale.sigma), math.exp(scale.log_scale))


def _located_sizes(
    known: KnownSizes, stature: Sequence[float], masks: Tensor, scene: SceneState
) -> LocatedSizes:
    """Find the scene points and people at the pixels of known lengths."""
    used = {}
    for i, length in enumerate(known.lengths):
        start, end = (_locate_end(pixel, masks, scene) for pixel in (length.start, length.end))
        if start is not None and end is not None:
            used[i] = start, end
    lengths = [known.lengths[i] for i in used]
    ends = [end for both in used.values() for end in both]
    pixels = torch.tensor([(n.start, n.end) for n in lengths], dtype=torch.float64).view(-1, 2, 2)
    homogeneous = torch.cat([pixels, torch.ones_like(pixels[..., :1])], -1)
    distances = LocatedDistances(
        metres=torch.tensor([n.metres for n in lengths], dtype=torch.float64),
        person=torch.tensor([person for person, _ in ends], dtype=torch.int64).view(-1, 2),
        points=torch.tensor([point for _, point in ends], dtype=torch.float64).view(-1, 2, 3),
        rays=homogeneous @ torch.linalg.inv(scene.K.double()).T,
        index=torch.tensor([*used], dtype=torch.int64),
    )
    return LocatedSizes(
        torch.tensor(list(stature), dtype=torch.float64),
        known.camera_height,
        distances,
        tuple(i for i in range(len(known.lengths)) if i not in used),
    )


def _locate_end(
    pixel: Sequence[float], masks: Tensor, scene: SceneState
) -> tuple[int, list[float]] | None:
    """Return the person at a pixel and NaN (3,), or ``_ON_SCENE`` and the point (3,) of the scene;
    None if neither is there.
    """
    x, y = (round(value) for value in pixel)
    height, width = scene.valid.shape
    if not (0 <= x < width and 0 <= y < height):
        return None
    shown = masks[:, y, x].nonzero().flatten().tolist()
    if shown:
        return min(shown, key=lambda p: int(masks[p].sum())), [math.nan] * 3
    point = _scene_point(scene, x, y)
    return None if point is None else (_ON_SCENE, point)


# Of the long side: radius in which a pixel without a scene point takes the nearest one.
_SEARCH_SHARE = 0.01


def _scene_point(scene: SceneState, x: int, y: int) -> list[float] | None:
    """Return the valid scene point (3,) nearest to a pixel, moved onto its ray; None if there is
    none nearby.
    """
    reach = max(2, round(_SEARCH_SHARE * max(scene.valid.shape)))
    top = max(0, y - reach)
    left = max(0, x - reach)
    rows, columns = scene.valid[top : y + reach + 1, left : x + reach + 1].nonzero(as_tuple=True)
    if not len(rows):
        return None
    nearest = int(((rows + top - y).square() + (columns + left - x).square()).argmin())
    return scene.points[rows[nearest] + top, columns[nearest] + left].tolist()


def scale_scene(
    scene: SceneState, known: LocatedSizes, factor: float
) -> tuple[SceneState, LocatedSizes]:
    """Scale the scene about the camera."""
    floor = scene.floor and scene.floor.scaled(factor)
    points = scene.points * factor
    floor_points = scene.floor_points * factor
    scaled = replace(scene, points=points, floor_points=floor_points, floor=floor)
    distances = replace(known.distances, points=known.distances.points * factor)
    return scaled, replace(known, distances=distances, unscaled=scene, factor=factor)
