"""Stage 2: translate each body to fit its keypoints (Eq. 2) and its human points (Eq. 3-4).

The robust method minimises for each person, by Gauss-Newton steps with nearest points updated at each step,

    lambda_j2d mean_j rho(|pi(J_j + t) - u_j|^2 / size^2)
    + lambda_d (mean_v min_p rho(|v + t - e^g p|^2) + mean_p min_v rho(|e^g p - v - t|^2))
    + floor_weight rho(h(t)^2) + offset cost (g / sigma)^2

over the translation t and the depth offset g. g is free if the person's feet are visible and there is a floor.
Monocular depth places people farther away than the floor under their feet, so without g the body leaves the floor. If
both feet without g are well above the floor, the person is on furniture or steps, and g is 0. Means and relative sizes
make all terms independent of the resolution. The paper's methods use sums of squares with Adam and L-BFGS.

OpenCV camera frame, metres. Float64 on the CPU, which is fastest for k-d trees of a few thousand points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from physic_core.engine.joint.released.visibility import is_opposite_optical_axis
from physic_core.engine.placement.settings import PlacementSettings
from physic_core.engine.placement.solvers import (
    closed_form_translation,
    gauss_newton,
    reprojection_loss,
    restore_keypoint_fit,
    solve_adam,
    solve_lbfgs,
    term_energy,
)
from physic_core.engine.placement.terms import (
    FEWEST_KEYPOINTS,
    NEAREST_M,
    ChamferTerm,
    FloorTerm,
    PlacementProblem,
    ReprojectionTerm,
    Term,
)
from physic_core.geometry.camera import project
from physic_core.geometry.plane import height_over_plane
from physic_core.geometry.visibility import facing, inside_mask
from physic_core.types.short_repr import ShortRepr

__all__ = ["PeopleObservations", "PersonPlacement", "Placement", "PosedBodies", "place_bodies"]

_MIN_POINTS = 50  # least number of human points and of camera-facing vertices for Eq. 4
_FACING_DEG = 70.0  # between a vertex's normal and the direction to the camera
_RELEASED_FACING_DEG = 80.0
_STAND_REACH_SHARE = 0.15  # upper limit of ``stand_reach_m`` as a share of the distance from the camera
_ROUNDS = 2  # selections of camera-facing vertices
_MOVED_M = 1e-3


@dataclass(frozen=True)
class PosedBodies:
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
    """Observed keypoints, 3D points and masks of B people.

    Attributes:
        keypoints: (B, J, 2) px.
        confidence: (B, J) in [0, 1].
        points: B tensors (M_i, 3) metres, see :func:`physic_core.engine.placement.human_points.human_points`.
        masks: (B, H, W) bool, visible pixels of each person.
        feet_seen: (B,) bool, people with visible feet; None disables the floor term.
    """

    keypoints: Tensor
    confidence: Tensor
    points: Sequence[Tensor]
    masks: Tensor
    feet_seen: Tensor | None = None


@dataclass(frozen=True)
class PersonPlacement(ShortRepr):
    """Placement of one person, float64 on the CPU.

    Attributes:
        move: (3,) metres, added to the estimated translation.
        depth_offset: factor on the depth of the person's points.
        grounded: False for a person on furniture or steps.
        on_floor: whether the floor was used.
        keypoint_move: (3,) metres, translation by the keypoints alone (Eq. 2).
        diagnostics: see :class:`Placement`.
    """

    move: Tensor
    depth_offset: float
    grounded: bool
    on_floor: bool
    keypoint_move: Tensor
    diagnostics: Mapping[str, Any]


@dataclass(frozen=True)
class Placement(ShortRepr):
    """Placement of B bodies.

    Attributes:
        transl: (B, 3) metres.
        depth_offset: (B,) factor on the depth of a person's points to match the body; 1 if fixed to the scene.
        grounded: (B,) bool, False for a person with both feet well above the floor.
        diagnostics: one mapping per person: numbers of "keypoints", "facing_vertices" and "points" used;
            "reprojection_px" and "chamfer_m", medians at start and end; "losses", term of Eq. 3 -> its energy at
            "start" and "end"; "moved_m"; "depth_offset"; "grounded"; "foot_height_m" over the floor (None without a
            floor, and for a person not on it); "problem", a message or None.
        keypoint_transl: (B, 3) metres, by the keypoints alone (Eq. 2).
        people: placement of each person.
    """

    transl: Tensor
    depth_offset: Tensor
    grounded: Tensor
    diagnostics: tuple[Mapping[str, Any], ...]
    keypoint_transl: Tensor
    people: tuple[PersonPlacement, ...] = ()


def place_bodies(
    bodies: PosedBodies,
    evidence: PeopleObservations,
    K: Tensor,
    floor: tuple[Tensor, float] | None = None,
    settings: PlacementSettings | None = None,
    placed: Sequence[PersonPlacement | None] | None = None,
) -> Placement:
    """Translate B posed bodies independently (Eq. 2-4); a body that cannot be placed keeps its translation.

    Args:
        bodies: as estimated.
        evidence: keypoints, points and masks of the B people.
        K: (3, 3) px.
        floor: unit normal (3,), up, and offset in metres, or None.
        settings: of stage 2; preset "default" if None.
        placed: per person, a known placement to reuse, or None to solve; None solves all.
    """
    settings = settings or PlacementSettings()
    known = placed or [None] * len(bodies.transl)
    people = tuple(
        _place_person(_person_problem(i, bodies, evidence, K, floor, settings), settings) if done is None else done
        for i, done in enumerate(known)
    )
    transl = bodies.transl
    if not people:
        return Placement(transl, transl.new_ones((0,)), torch.ones_like(transl[:, 0], dtype=torch.bool), (), transl)
    return Placement(
        transl=transl + torch.stack([p.move for p in people]).to(transl),
        depth_offset=torch.tensor([p.depth_offset for p in people], dtype=transl.dtype, device=transl.device),
        grounded=torch.tensor([p.grounded for p in people], device=transl.device),
        diagnostics=tuple(p.diagnostics for p in people),
        keypoint_transl=transl + torch.stack([p.keypoint_move for p in people]).to(transl),
        people=people,
    )


def _person_problem(
    i: int,
    bodies: PosedBodies,
    evidence: PeopleObservations,
    K: Tensor,
    floor: tuple[Tensor, float] | None,
    settings: PlacementSettings,
) -> PlacementProblem:
    """Return the problem of person i with usable keypoints and points only."""
    uv, confidence = _on_cpu(evidence.keypoints[i]), _on_cpu(evidence.confidence[i])
    landmarks, vertices, cloud = (_on_cpu(x) for x in (bodies.landmarks[i], bodies.vertices[i], evidence.points[i]))
    used = (confidence >= settings.min_confidence) & torch.isfinite(uv).all(-1) & torch.isfinite(landmarks).all(-1)
    # As released: a person hidden behind another counts as visible.
    mask = (evidence.masks.any(0) if settings.method == "released" else evidence.masks[i]).cpu()
    rows, columns = mask.shape
    size = torch.tensor([columns, rows], dtype=torch.float64)
    plane, soles = torch.zeros(4, dtype=torch.float64), vertices[:0]
    if floor is not None and bodies.soles is not None and evidence.feet_seen is not None and evidence.feet_seen[i]:
        plane = torch.cat((_on_cpu(floor[0]), torch.tensor([floor[1]], dtype=torch.float64)))
        soles = vertices[bodies.soles.cpu()]
    return PlacementProblem(
        landmarks=landmarks[used],
        keypoints=uv[used],
        confidence=confidence[used],
        size=_image_size_of(uv[used], mask) if settings.robust else size,
        vertices=vertices,
        normals=_on_cpu(bodies.normals[i]),
        outer=torch.ones(len(vertices), dtype=torch.bool) if bodies.outer is None else bodies.outer.cpu(),
        points=cloud[torch.isfinite(cloud).all(-1)],
        mask=mask,
        soles=soles,
        plane=plane,
        K=_on_cpu(K),
        people=len(bodies.transl),
    )


def _on_cpu(x: Tensor) -> Tensor:
    return x.detach().to("cpu", torch.float64)


def _image_size_of(keypoints: Tensor, mask: Tensor) -> Tensor:
    """Return the diagonal of the person's image box, px, twice (2,)."""
    corners = keypoints
    if bool(mask.any()):
        rows, columns = mask.any(1).nonzero()[:, 0], mask.any(0).nonzero()[:, 0]
        ends = torch.tensor([[int(columns[0]), int(rows[0])], [int(columns[-1]), int(rows[-1])]], dtype=torch.float64)
        corners = torch.cat((corners, ends))
    if not len(corners):
        return torch.ones(2, dtype=torch.float64)
    diagonal: Tensor = torch.linalg.vector_norm(corners.amax(0) - corners.amin(0)).clamp(min=1.0)
    return diagonal.expand(2)


@dataclass(frozen=True)
class _Fit:
    """Translation and log depth offset by Eq. 3-4.

    Attributes:
        x: (4,).
        seen: (V,) bool, the camera-facing vertices of Eq. 4.
        chamfer_m: median distance before and after; None with too few points or vertices.
        grounded: False for a person on furniture or steps.
    """

    x: Tensor
    seen: Tensor
    chamfer_m: tuple[float, float] | None = None
    grounded: bool = True

    @property
    def pairs(self) -> Tensor | None:
        """``seen``, or None if Eq. 4 was not used."""
        return None if self.chamfer_m is None else self.seen


def _place_person(person: PlacementProblem, settings: PlacementSettings) -> PersonPlacement:
    start = torch.zeros(4, dtype=torch.float64)
    on_floor = person.on_floor
    fit, by_keypoints = _Fit(start, torch.zeros(len(person.vertices), dtype=torch.bool)), start
    if not bool(torch.isfinite(person.vertices).all()):
        problem: str | None = "the body has non-finite vertices: its translation was not changed"
    else:
        by_keypoints, problem = _fit_keypoints(person, settings)
        fit = replace(fit, x=by_keypoints)
        if settings.chamfer_weight > 0:
            fit = _fit_points(person, by_keypoints, settings)
            if not fit.grounded:
                person = person._replace(soles=person.soles[:0])
            if fit.chamfer_m is None and problem is None:
                problem = (
                    f"{len(person.points)} points and {int(fit.seen.sum())} camera-facing vertices of the person, "
                    f"{_MIN_POINTS} of each are needed: placed by keypoints alone"
                )
        if settings.method == "paper":
            fit = replace(fit, x=_bounded_by_keypoints(person, fit, settings))
        if not bool(torch.isfinite(fit.x).all()) or float((person.vertices[:, 2] + fit.x[2]).median()) < NEAREST_M:
            fit, by_keypoints = replace(fit, x=start), start
            problem = "the fit has no translation in front of the camera: the translation was not changed"
    return PersonPlacement(
        move=fit.x[:3],
        depth_offset=math.exp(float(fit.x[3])),
        grounded=fit.grounded,
        on_floor=on_floor,
        keypoint_move=by_keypoints[:3],
        diagnostics=_diagnostics(person, fit, problem, settings),
    )


def _diagnostics(
    person: PlacementProblem, fit: _Fit, problem: str | None, settings: PlacementSettings
) -> dict[str, Any]:
    start, x = torch.zeros_like(fit.x), fit.x
    foot = None
    if person.on_floor:
        foot = float(height_over_plane(person.soles + x[:3], person.plane[:3], person.plane[3]).min())
    return {
        "keypoints": len(person.keypoints),
        "points": len(person.points),
        "facing_vertices": int(fit.seen.sum()),
        "reprojection_px": (_reprojection_px(person, start), _reprojection_px(person, x)),
        "chamfer_m": fit.chamfer_m,
        "losses": _losses(person, fit, settings),
        "moved_m": float(torch.linalg.vector_norm(x[:3])),
        "depth_offset": math.exp(float(x[3])),
        "foot_height_m": foot,
        "grounded": fit.grounded,
        "problem": problem,
    }


def _losses(person: PlacementProblem, fit: _Fit, settings: PlacementSettings) -> dict[str, dict[str, float]]:
    """Return the energy of each used term of Eq. 3 at the estimated and at the final translation."""
    terms: dict[str, Term] = {}
    if not bool(torch.isfinite(person.vertices).all()):
        return {}
    if len(person.keypoints) >= FEWEST_KEYPOINTS:
        terms["reprojection"] = ReprojectionTerm(person, settings)
    if fit.pairs is not None:
        terms["chamfer"] = ChamferTerm(person, fit.pairs, settings)
        if _has_offset(person, settings):
            terms["floor"] = FloorTerm(person, settings)
    ends = {"start": torch.zeros_like(fit.x), "end": fit.x}
    losses = {name: {end: term_energy(term, at) for end, at in ends.items()} for name, term in terms.items()}
    if "reprojection" in losses and settings.method == "released":
        weight = settings.reprojection_weight
        losses["reprojection"] = {
            end: weight * float(reprojection_loss(person, at[:3], settings)) for end, at in ends.items()
        }
    return losses


def _has_offset(person: PlacementProblem, settings: PlacementSettings) -> bool:
    """Return whether the person's depth offset is free."""
    return settings.robust and person.on_floor and settings.depth_offset_sigma > 0


def _fit_keypoints(person: PlacementProblem, settings: PlacementSettings) -> tuple[Tensor, str | None]:
    """Solve Eq. 2: return x (4,), and a message if there are too few keypoints."""
    if len(person.keypoints) < FEWEST_KEYPOINTS:
        return torch.zeros(4, dtype=torch.float64), (
            f"{len(person.keypoints)} keypoints have confidence {settings.min_confidence:g} or more, "
            f"{FEWEST_KEYPOINTS} are needed to place a body by them"
        )
    if not settings.robust:
        return solve_adam(person, settings), None
    return gauss_newton([ReprojectionTerm(person, settings)], closed_form_translation(person), (0, 1, 2)), None


def _fit_points(person: PlacementProblem, x: Tensor, settings: PlacementSettings) -> _Fit:
    """Solve Eq. 3-4 from x (4,); camera-facing vertices are selected again after the body has moved."""
    seen = _camera_facing(person, x, settings)
    if len(person.points) < _MIN_POINTS or int(seen.sum()) < _MIN_POINTS:
        return _Fit(x, seen)
    chamfer = ChamferTerm(person, seen, settings)
    before = chamfer.median(x)
    if not settings.robust:
        x = solve_lbfgs(person, x, chamfer, settings)
        return _Fit(x, seen, (before, chamfer.median(x)))
    others: list[Term] = [ReprojectionTerm(person, settings)] if len(person.keypoints) >= FEWEST_KEYPOINTS else []
    grounded = not _is_on_furniture(person, x, [chamfer, *others], settings)
    offset = grounded and _has_offset(person, settings)
    if offset:
        others.insert(0, FloorTerm(person, settings))
    for _ in range(_ROUNDS):
        last = x
        x = gauss_newton([chamfer, *others], x, (0, 1, 2, 3) if offset else (0, 1, 2))
        again = _camera_facing(person, x, settings)
        if float((x - last).abs().max()) < _MOVED_M or int(again.sum()) < _MIN_POINTS:
            break
        seen, chamfer = again, ChamferTerm(person, again, settings)
    return _Fit(x, seen, (before, chamfer.median(x)), grounded)


def _is_on_furniture(person: PlacementProblem, x: Tensor, terms: list[Term], settings: PlacementSettings) -> bool:
    """Return whether a fit without depth offset has both feet well above the floor."""
    if not settings.stand_reach_m or not _has_offset(person, settings):
        return False
    fixed = gauss_newton(terms, x, (0, 1, 2))
    lower = float(height_over_plane(person.soles + fixed[:3], person.plane[:3], person.plane[3]).min())
    away = float((person.vertices[:, 2] + fixed[2]).median())
    return lower > min(settings.stand_reach_m, _STAND_REACH_SHARE * away)


def _camera_facing(person: PlacementProblem, x: Tensor, settings: PlacementSettings) -> Tensor:
    """Return vertices V_cf of Eq. 4, which face the camera and project into the person's mask: (V,) bool."""
    moved = person.vertices + x[:3]
    if settings.method == "released":
        seen = is_opposite_optical_axis(person.normals, _RELEASED_FACING_DEG)
    else:
        seen = facing(person.normals, moved, _FACING_DEG)
    seen = seen & (moved[:, 2] > NEAREST_M)
    return seen & person.outer & inside_mask(project(moved, person.K), person.mask)


def _bounded_by_keypoints(person: PlacementProblem, fit: _Fit, settings: PlacementSettings) -> Tensor:
    """Return x (4,), moved towards the keypoints until their error is no larger than at the start."""
    if len(person.keypoints) < FEWEST_KEYPOINTS:
        return fit.x
    came, term = torch.zeros_like(fit.x), ReprojectionTerm(person, settings)
    largest = term_energy(term, came), _reprojection_px(person, came) or 0.0

    def fits(at: Tensor) -> bool:
        return term_energy(term, at) <= largest[0] and (_reprojection_px(person, at) or 0.0) <= largest[1]

    # The total weight of all pairs of Eq. 4. Without points its value has no effect.
    pairs = 1 if fit.pairs is None else int(fit.pairs.sum()) + len(person.points)
    return restore_keypoint_fit(person, fit.x, settings.chamfer_weight * pairs, settings, fits)


def _reprojection_px(person: PlacementProblem, x: Tensor) -> float | None:
    """Return the median reprojection error of the used keypoints, px."""
    if not len(person.keypoints):
        return None
    uv = project(person.landmarks + x[:3], person.K)
    return float(torch.linalg.vector_norm(uv - person.keypoints, dim=-1).median())
