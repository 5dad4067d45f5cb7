"""Stage 2: translate each body to fit its keypoints (Eq. 2) and its human points (Eq. 3-4).

:class:`physic_core.engine.placement.method.PlacementMethod` states the energy. Float64 on the CPU,
which is fastest for k-d trees of a few thousand points. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from physic_core.engine.placement.method import FEWEST_POINTS, Fit, PlacementMethod
from physic_core.engine.placement.terms import FEWEST_KEYPOINTS, NEAREST_M, PlacementProblem
from physic_core.geometry.camera import project
from physic_core.types import Skeleton
from physic_core.types.short_repr import ShortRepr

_FARTHEST = 1e3  # largest distance of a placed body, over the estimated distance


@dataclass(frozen=True)
class ObservedPeople:
    """Results of detectors and estimators for B people.

    Attributes:
        skeleton: of the J keypoints.
        keypoints: (B, J, 2) px.
        confidence: (B, J) in [0, 1].
        observed: (B, 55) bool, joints that the body estimator reports as visible.
        masks: (B, H, W) bool, visible pixels of each person.
    """

    skeleton: Skeleton
    keypoints: Tensor
    confidence: Tensor
    observed: Tensor
    masks: Tensor


@dataclass(frozen=True)
class PlacedBodies:
    """B estimated bodies, metres, camera frame.

    Attributes:
        vertices: (B, V, 3).
        normals: (B, V, 3) unit, out of the mesh.
        landmarks: (B, J, 3), in the order of the keypoints.
        transl: (B, 3), translation included in vertices and landmarks.
        outer: (V,) bool, False for vertices inside mouth and eyes; None means all True.
        soles: (S,) int64 sole vertices; None disables the floor term.
    """

    vertices: Tensor
    normals: Tensor
    landmarks: Tensor
    transl: Tensor
    outer: Tensor | None = None
    soles: Tensor | None = None


@dataclass(frozen=True)
class PeopleObservations:
    """What B people are placed by: of the :class:`ObservedPeople`, the keypoints that the method
    uses with its weights.

    Attributes:
        keypoints: (B, J, 2) px.
        confidence: (B, J) in [0, 1].
        points: B tensors (M_i, 3) metres, see
            :func:`physic_core.engine.placement.solve.human_points`.
        masks: (B, H, W) bool, visible pixels of each person.
        feet_seen: (B,) bool, people with visible feet; None disables the floor term.
    """

    keypoints: Tensor
    confidence: Tensor
    points: Sequence[Tensor]
    masks: Tensor
    feet_seen: Tensor | None = None


@dataclass(frozen=True)
class Placement(ShortRepr):
    """Placement of B bodies.

    Attributes:
        transl: (B, 3) metres.
        diagnostics: one mapping per person: numbers of "keypoints", "facing_vertices" and "points"
            used; "reprojection_px" and "chamfer_m", medians at start and end; "losses", term of Eq.
            3 -> its energy at "start" and "end"; "moved_m"; "depth_offset"; "foot_height_m" over
            the floor (None without a floor, and for a person not on it); "problem", a message or
            None.
        keypoint_transl: (B, 3) metres, by the keypoints alone (Eq. 2).
        on_floor: per person, whether the floor was used.
    """

    transl: Tensor
    diagnostics: tuple[Mapping[str, Any], ...]
    keypoint_transl: Tensor
    on_floor: tuple[bool, ...] = ()


def place_bodies(
    bodies: PlacedBodies,
    evidence: PeopleObservations,
    K: Tensor,
    floor: tuple[Tensor, float] | None = None,
    method: PlacementMethod | None = None,
) -> Placement:
    """Translate B posed bodies independently (Eq.

    2-4); a body that cannot be placed keeps its translation.

    Args:
        bodies: as estimated.
        evidence: keypoints, points and masks of the B people.
        K: (3, 3) px.
        floor: unit normal (3,), up, and offset in metres, or None.
        method: of stage 2; that of preset "default" if None.
    """
    method = method or PlacementMethod()
    transl = bodies.transl
    people = [_person_problem(i, bodies, evidence, K, floor, method) for i in range(len(transl))]
    if not people:
        return Placement(transl, (), transl)
    moves, keypoint_moves, diagnostics = zip(
        *(_place_person(person, method) for person in people), strict=True
    )
    return Placement(
        transl=transl + torch.stack(moves).to(transl),
        diagnostics=diagnostics,
        keypoint_transl=transl + torch.stack(keypoint_moves).to(transl),
        on_floor=tuple(person.on_floor for person in people),
    )


def _person_problem(
    i: int,
    bodies: PlacedBodies,
    evidence: PeopleObservations,
    K: Tensor,
    floor: tuple[Tensor, float] | None,
    method: PlacementMethod,
) -> PlacementProblem:
    """Return the problem of person i with usable keypoints and points only."""
    uv = _on_cpu(evidence.keypoints[i])
    confidence = _on_cpu(evidence.confidence[i])
    landmarks, vertices, cloud = (
        _on_cpu(x) for x in (bodies.landmarks[i], bodies.vertices[i], evidence.points[i])
    )
    used = (
        (confidence >= method.min_confidence)
        & torch.isfinite(uv).all(-1)
        & torch.isfinite(landmarks).all(-1)
    )
    mask = method.mask(evidence.masks, i).cpu()
    plane = None
    soles = vertices[:0]
    if (
        floor is not None
        and bodies.soles is not None
        and evidence.feet_seen is not None
        and evidence.feet_seen[i]
    ):
        plane = torch.cat((_on_cpu(floor[0]), torch.tensor([floor[1]], dtype=torch.float64)))
        soles = vertices[bodies.soles.cpu()]
    return PlacementProblem(
        landmarks=landmarks[used],
        keypoints=uv[used],
        confidence=confidence[used],
        size=method.error_unit(uv[used], mask),
        vertices=vertices,
        normals=_on_cpu(bodies.normals[i]),
        outer=torch.ones(len(vertices), dtype=torch.bool)
        if bodies.outer is None
        else bodies.outer.cpu(),
        points=cloud[torch.isfinite(cloud).all(-1)],
        mask=mask,
        soles=soles,
        plane=plane,
        K=_on_cpu(K),
        row=i,
        people=len(bodies.transl),
    )


def _on_cpu(x: Tensor) -> Tensor:
    return x.detach().to("cpu", torch.float64)


def _place_person(
    person: PlacementProblem, method: PlacementMethod
) -> tuple[Tensor, Tensor, Mapping[str, Any]]:
    """Return the translation (3,), the one by only the keypoints (3,), metres, and the diagnostics
    of a person.
    """
    start = torch.zeros(4, dtype=torch.float64)
    fit = Fit(start, torch.zeros(len(person.vertices), dtype=torch.bool))
    by_keypoints = start
    if not bool(torch.isfinite(person.vertices).all()):
        problem: str | None = "the body has non-finite vertices: its translation was not changed"
    elif method.is_placed(person) and not bool(person.mask.any()):
        problem = None
    else:
        problem = None
        if len(person.keypoints) >= FEWEST_KEYPOINTS:
            by_keypoints = method.fit_keypoints(person)
            if not _is_placed_in_view(person, by_keypoints):
                by_keypoints = start
        else:
            problem = (
                f"{len(person.keypoints)} keypoints have confidence {method.min_confidence:g} or "
                f"more, "
                f"but {FEWEST_KEYPOINTS} are needed to place a body"
            )
        fit = replace(fit, x=by_keypoints)
        if method.chamfer_weight > 0:
            fit = method.fit_points(person, by_keypoints)
            if fit.chamfer_m is None and problem is None:
                problem = (
                    f"{len(person.points)} points and {int(fit.seen.sum())} camera-facing "
                    f"vertices of the person, "
                    f"but {FEWEST_POINTS} of each are needed: placed by keypoints alone"
                )
        fit = replace(fit, x=method.finish(person, fit))
        if not _is_placed_in_view(person, fit.x):
            fit = replace(fit, x=start)
            by_keypoints = start
            problem = (
                "the fit has no translation in front of the camera: the translation was not changed"
            )
    return fit.x[:-1], by_keypoints[:-1], _diagnostics(person, fit, problem, method)


def _is_placed_in_view(person: PlacementProblem, x: Tensor) -> bool:
    """Return whether x (4,) places a body in front of the camera, and not near infinity.

    With keypoint errors larger than the person, a robust fit can shrink the person to a point.
    """
    depth = float(person.vertices[:, 2].median())
    farthest = _FARTHEST * max(depth, NEAREST_M)
    return bool(torch.isfinite(x).all()) and NEAREST_M <= depth + float(x[2]) <= farthest


def _diagnostics(
    person: PlacementProblem, fit: Fit, problem: str | None, method: PlacementMethod
) -> dict[str, Any]:
    """Return the diagnostics of a person's placement: data used, errors, and distance moved."""
    start = torch.zeros_like(fit.x)
    x = fit.x
    return {
        "keypoints": len(person.keypoints),
        "points": len(person.points),
        "facing_vertices": int(fit.seen.sum()),
        "reprojection_px": (
            median_reprojection_px(person, start),
            median_reprojection_px(person, x),
        ),
        "chamfer_m": fit.chamfer_m,
        "losses": method.losses(person, fit),
        "moved_m": float(torch.linalg.vector_norm(x[:-1])),
        "depth_offset": math.exp(float(x[-1])),
        "foot_height_m": float(person.foot_height(x)) if person.on_floor else None,
        "problem": problem,
    }


def median_reprojection_px(person: PlacementProblem, x: Tensor) -> float | None:
    """Return the median reprojection error of the used keypoints, px."""
    if not len(person.keypoints):
        return None
    uv = project(person.landmarks + x[:-1], person.K)
    return float(torch.linalg.vector_norm(uv - person.keypoints, dim=-1).median())
