"""Known sizes as constraints of the engine: statures, the camera's height over the floor, and lengths between pixels.

A photo shows sizes only up to one common factor. The camera's height and lengths on the scene give the factor of the
scene, statures that of the people. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.engine.scene.solve import SceneState
from physic_core.engine.sizes.body_points import BodyPoint, vertices_at_ray
from physic_core.engine.sizes.evidence import ScaleEvidence, combine
from physic_core.types import KnownSizes
from physic_core.types.short_repr import ShortRepr

_SEARCH_SHARE = 0.01  # of the long side: radius in which a pixel without a scene point takes the nearest one


BodyEnds = tuple[BodyPoint | None, ...]
"""Points of the two ends of a distance on bodies; None for an end on the scene."""


@dataclass(frozen=True)
class KnownDistances(ShortRepr):
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
        """Choose, for each distance, the points of its ends on bodies (B, V, 3) with normals (B, V, 3)."""
        return [
            tuple(
                vertices_at_ray(vertices[person], normals[person], ray, K) if person >= 0 else None
                for person, ray in zip(people, rays, strict=True)
            )
            for people, rays in zip(self.person.tolist(), self.rays, strict=True)
        ]

    def measure(self, ends: Sequence[BodyEnds], vertices: Tensor, scale: Tensor | float) -> list[Tensor]:
        """Return the distances, metres, between people with vertices (B, V, 3) in a scene at a scale; differentiable.

        Args:
            ends: of :meth:`ends_on_bodies`.
            vertices: (B, V, 3).
            scale: factor on the points of the scene.
        """
        found = []
        for i, on_bodies in enumerate(ends):
            start, end = (
                self.points[i, side] * scale if on is None else on(vertices[person])
                for side, (on, person) in enumerate(zip(on_bodies, self.person[i].tolist(), strict=True))
            )
            found.append(torch.linalg.vector_norm(start - end))
        return found

    def __getitem__(self, rows: Tensor) -> KnownDistances:
        return KnownDistances(
            self.metres[rows], self.person[rows], self.points[rows], self.rays[rows], self.index[rows]
        )


@dataclass(frozen=True)
class KnownGeometry(ShortRepr):
    """Known sizes of B people and their scene, all in metres.

    Attributes:
        stature: (B,), NaN where unknown.
        camera_height: over the floor, or None.
        distances: between points of the scene or of people.
        unused: per given length without a point at one of its pixels, its position.
    """

    stature: Tensor
    camera_height: float | None
    distances: KnownDistances
    unused: tuple[int, ...] = ()

    def select_people(self, rows: Tensor) -> KnownGeometry:
        """Return the sizes of a selection of the people, (n,) int64; distances on other people are skipped."""
        new_row = torch.full((len(self.stature) + 1,), -2, dtype=torch.int64, device=rows.device)
        new_row[rows] = torch.arange(len(rows), device=rows.device)
        new_row[-1] = -1
        person = new_row[self.distances.person]
        distances = replace(self.distances, person=person)[(person >= -1).all(1)]
        return replace(self, stature=self.stature[rows], distances=distances)


@dataclass(frozen=True)
class KnownScene(ShortRepr):
    """Scene that has the size that the user's sizes give it.

    Attributes:
        scene: scaled.
        unscaled: the same by stage 1.
        geometry: known sizes in ``scene``.
        evidence: of the factor on the scene; None if no size gives it, and nothing was scaled.
    """

    scene: SceneState
    unscaled: SceneState
    geometry: KnownGeometry
    evidence: ScaleEvidence | None

    @property
    def factor(self) -> float | None:
        """Factor on the scene, or None."""
        return None if self.evidence is None else math.exp(self.evidence.log_scale)


def scale_scene_to_known_sizes(
    known: KnownSizes, stature: Sequence[float], masks: Tensor, scene: SceneState
) -> KnownScene:
    """Scale the scene to known sizes, if they give its scale.

    The camera height and each length whose ends are both on the scene are evidence of it.

    Args:
        known: pixels in px of the image.
        stature: (B,) metres, NaN where unknown.
        masks: (B, H, W) bool. A pixel in a mask is on that person, the smallest one where masks overlap.
        scene: stage 1.
    """
    geometry = _known_geometry(known, stature, masks, scene)
    evidence = []
    if known.camera_height is not None and scene.floor_normal is not None:
        evidence.append(ScaleEvidence.by_known_size(known.camera_height, scene.floor_offset))
    d = geometry.distances
    on_scene = (d.person < 0).all(1)
    extent = torch.linalg.vector_norm(d.points[on_scene, 0] - d.points[on_scene, 1], dim=-1)
    shown = zip(d.metres[on_scene].tolist(), extent.clamp(min=1e-6).tolist(), strict=True)
    evidence += [ScaleEvidence.by_known_size(metres, length) for metres, length in shown]
    found = combine(evidence)
    if found is None:
        return KnownScene(scene, scene, geometry, None)
    scaled, geometry = scale_scene(scene, geometry, math.exp(found.log_scale))
    return KnownScene(scaled, scene, geometry, found)


def _known_geometry(known: KnownSizes, stature: Sequence[float], masks: Tensor, scene: SceneState) -> KnownGeometry:
    """Find the scene points and people at the pixels of known lengths."""
    masks, height, width = masks.cpu(), *scene.valid.shape
    area = masks.flatten(1).sum(1)
    inverse = torch.linalg.inv(scene.K.double().cpu())
    nothing = torch.full((3,), torch.nan, dtype=torch.float64)
    person, at, rays = [torch.zeros(0, 2)], [nothing.expand(0, 2, -1)], [nothing.expand(0, 2, -1)]
    used, unused = [], []
    for i, length in enumerate(known.lengths):
        pixels = torch.tensor([length.start, length.end], dtype=torch.float64)
        people, points = [], []
        for x, y in pixels.round().long().tolist():
            inside = 0 <= x < width and 0 <= y < height
            shown = masks[:, y, x].nonzero().flatten().tolist() if inside else []
            people.append(min(shown, key=lambda p: int(area[p])) if shown else -1)
            points.append(None if shown or not inside else _scene_point(scene, x, y))
        if any(person < 0 and point is None for person, point in zip(people, points, strict=True)):
            unused.append(i)
            continue
        person.append(torch.tensor([people]))
        at.append(torch.stack([nothing if p is None else p for p in points])[None])
        rays.append((torch.cat([pixels, torch.ones(2, 1, dtype=torch.float64)], 1) @ inverse.T)[None])
        used.append(i)
    metres = torch.tensor([known.lengths[i].metres for i in used], dtype=torch.float64)
    index = torch.tensor(used, dtype=torch.int64)
    distances = KnownDistances(metres, torch.cat(person).long(), torch.cat(at), torch.cat(rays), index)
    return KnownGeometry(
        torch.tensor(list(stature), dtype=torch.float64), known.camera_height, distances, tuple(unused)
    )


def _scene_point(scene: SceneState, x: int, y: int) -> Tensor | None:
    """Return the valid scene point (3,) nearest to a pixel, moved onto its ray; None if there is none nearby."""
    reach = max(2, round(_SEARCH_SHARE * max(scene.valid.shape)))
    top, left = max(0, y - reach), max(0, x - reach)
    rows, columns = scene.valid[top : y + reach + 1, left : x + reach + 1].nonzero(as_tuple=True)
    if not len(rows):
        return None
    nearest = int(((rows + top - y).square() + (columns + left - x).square()).argmin())
    point: Tensor = scene.points[int(rows[nearest]) + top, int(columns[nearest]) + left]
    return point.detach().cpu().double()


def scale_scene(scene: SceneState, known: KnownGeometry, factor: float) -> tuple[SceneState, KnownGeometry]:
    """Scale the scene about the camera."""
    floor = None if scene.floor is None else replace(scene.floor, offset=scene.floor.offset * factor)
    scaled = replace(
        scene,
        points=scene.points * factor,
        floor_offset=scene.floor_offset * factor,
        floor_points=scene.floor_points * factor,
        floor=floor,
    )
    return scaled, replace(known, distances=replace(known.distances, points=known.distances.points * factor))
