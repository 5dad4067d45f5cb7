"""Stage 2: each body moved onto its keypoints (Eq. 2) and onto its points (Eq. 3-4); translation only.

Preset "default" minimises, for each person alone and by Gauss-Newton steps with nearest points found anew,

    lambda_j2d mean_j rho(|pi(J_j + t) - u_j|^2 / size^2)
    + lambda_d (mean_v min_p rho(|v + t - e^g p|^2) + mean_p min_v rho(|e^g p - v - t|^2))
    + floor_weight rho(h(t)^2) + offset cost (g / sigma)^2

over the translation t and, where the person's feet are seen and stand on a known floor, the depth offset g: monocular
depth sees people farther away than the floor under their feet, and without g that pulls the body off its floor. Who
without g has both feet well above the floor stands on steps or lies on a bed, and has none. Means and shares make all
terms independent of the picture's resolution. Preset "paper" is plain squares and sums with Adam and L-BFGS, and no
body ends farther off its keypoints than it came.

Works on the CPU in float64: a few thousand points and k-d trees are faster there than anywhere else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from physic_core.engine.joint.released_visibility import faces_optical_axis
from physic_core.engine.placement.solvers import (
    adam,
    closed_form,
    descend,
    lbfgs,
    loss,
    reprojection_loss,
    within_keypoints,
)
from physic_core.engine.placement.terms import (
    FEWEST_KEYPOINTS,
    NEAREST_M,
    Chamfer,
    Reprojection,
    Standing,
    Subject,
    Term,
)
from physic_core.engine.settings import HumanSettings
from physic_core.geometry.camera import project
from physic_core.geometry.plane import height
from physic_core.geometry.visibility import facing, inside_mask
from physic_core.types.short_repr import ShortRepr

__all__ = ["Placement", "place"]

_ROUNDS = 2
_MOVED_M = 1e-3


@dataclass(frozen=True)
class Placement(ShortRepr):
    """Where the bodies are.

    Attributes:
        transl: (B, 3) metres.
        depth_offset: (B,) factor on the depth of a person's points that makes them agree with the body; 1 where they
            were tied to the scene.
        grounded: (B,) bool, False for who stands, sits or lies with both feet well above the floor.
        diagnostics: one mapping a person: "keypoints" and "facing_vertices" and "points" used, "reprojection_px" and
            "chamfer_m" (medians) at start and end, "losses" (term of Eq. 3 -> its energy at "start" and "end"),
            "moved_m", "depth_offset", "grounded", "foot_height_m" over the floor (None without one, and for who is
            elsewhere), and "problem" in plain words or None.
        keypoint_transl: (B, 3) metres, where the keypoints alone (Eq. 2) put them.
    """

    transl: Tensor
    depth_offset: Tensor
    grounded: Tensor
    diagnostics: tuple[Mapping[str, Any], ...]
    keypoint_transl: Tensor


class _Placed(NamedTuple):
    """One person: translation to add (3,), depth offset, whether grounded, diagnostics, and Eq. 2's translation."""

    move: Tensor
    offset: float
    grounded: bool
    diagnostics: dict[str, Any]
    by_keypoints: Tensor


def place(
    vertices: Tensor,
    normals: Tensor,
    landmarks: Tensor,
    transl: Tensor,
    keypoints: Tensor,
    confidence: Tensor,
    K: Tensor,
    points: Sequence[Tensor],
    masks: Tensor,
    settings: HumanSettings | None = None,
    *,
    outer: Tensor | None = None,
    floor_normal: Tensor | None = None,
    floor_offset: float = 0.0,
    soles: Tensor | None = None,
    feet_seen: Tensor | None = None,
) -> Placement:
    """Move B posed bodies; each is solved alone, and one that cannot be placed keeps its translation.

    Args:
        vertices: (B, V, 3) metres, camera frame, posed with ``transl``.
        normals: (B, V, 3) unit, out of the mesh.
        landmarks: (B, J, 3) of the same bodies, in the keypoints' order.
        transl: (B, 3) metres, where the body estimator put them.
        keypoints: (B, J, 2) px.
        confidence: (B, J) in [0, 1].
        K: (3, 3) px.
        points: B tensors (M_i, 3) metres, see :func:`physic_core.engine.placement.human_points.human_points`.
        masks: (B, H, W) bool, visible pixels of each person.
        settings: of stage 2; preset "default" where None.
        outer: (V,) bool, False for vertices inside mouth and eyes; all True where None.
        floor_normal: (3,) unit, up, or None where there is no floor.
        floor_offset: of the floor, metres.
        soles: (S,) int64 vertices that can touch the floor; without them nobody stands.
        feet_seen: (B,) bool, whose feet the photo shows; without it nobody stands.
    """
    settings = settings or HumanSettings()
    if settings.visibility == "released":
        masks = masks.any(0, keepdim=True).expand_as(masks)
    people = _people(
        vertices, normals, landmarks, keypoints, confidence, K, points, masks, settings, outer, floor_normal,
        floor_offset, soles, feet_seen,
    )  # fmt: skip
    placed = [_place_one(person, settings) for person in people]
    if not placed:
        return Placement(transl, transl.new_ones((0,)), torch.ones_like(transl[:, 0], dtype=torch.bool), (), transl)
    return Placement(
        transl=transl + torch.stack([p.move for p in placed]).to(transl),
        depth_offset=torch.tensor([p.offset for p in placed], dtype=transl.dtype, device=transl.device),
        grounded=torch.tensor([p.grounded for p in placed], device=transl.device),
        diagnostics=tuple(p.diagnostics for p in placed),
        keypoint_transl=transl + torch.stack([p.by_keypoints for p in placed]).to(transl),
    )


def _people(
    vertices: Tensor,
    normals: Tensor,
    landmarks: Tensor,
    keypoints: Tensor,
    confidence: Tensor,
    K: Tensor,
    points: Sequence[Tensor],
    masks: Tensor,
    settings: HumanSettings,
    outer: Tensor | None,
    floor_normal: Tensor | None,
    floor_offset: float,
    soles: Tensor | None,
    feet_seen: Tensor | None,
) -> list[Subject]:
    def plain(x: Tensor) -> Tensor:
        return x.detach().to("cpu", torch.float64)

    keep = torch.ones(vertices.shape[1], dtype=torch.bool) if outer is None else outer.cpu()
    rows, columns = masks.shape[-2:]
    people = []
    for i in range(len(vertices)):
        uv, trust, joints = plain(keypoints[i]), plain(confidence[i]), plain(landmarks[i])
        used = (trust >= settings.min_confidence) & torch.isfinite(uv).all(-1) & torch.isfinite(joints).all(-1)
        uv, cloud = uv[used], plain(points[i])
        size = torch.tensor([columns, rows], dtype=torch.float64)
        if settings.normalisation == "person":
            size = _extent(uv, masks[i].cpu())
        body = plain(vertices[i])
        stands = floor_normal is not None and soles is not None and feet_seen is not None and bool(feet_seen[i])
        plane = torch.zeros(4, dtype=torch.float64)
        feet = body[:0]
        if stands and floor_normal is not None and soles is not None:
            plane = torch.cat((plain(floor_normal), torch.tensor([floor_offset], dtype=torch.float64)))
            feet = body[soles.cpu()]
        people.append(
            Subject(
                landmarks=joints[used],
                keypoints=uv,
                confidence=trust[used],
                size=size,
                vertices=body,
                normals=plain(normals[i]),
                outer=keep,
                points=cloud[torch.isfinite(cloud).all(-1)],
                mask=masks[i].cpu(),
                soles=feet,
                plane=plane,
                K=plain(K),
                people=len(vertices),
            )
        )
    return people


def _extent(keypoints: Tensor, mask: Tensor) -> Tensor:
    """(2,) the diagonal of the person's box in the picture, px, twice: what a 2D error is measured against."""
    corners = keypoints
    if bool(mask.any()):
        rows, columns = mask.any(1).nonzero()[:, 0], mask.any(0).nonzero()[:, 0]
        ends = torch.tensor([[int(columns[0]), int(rows[0])], [int(columns[-1]), int(rows[-1])]], dtype=torch.float64)
        corners = torch.cat((corners, ends))
    if not len(corners):
        return torch.ones(2, dtype=torch.float64)
    diagonal: Tensor = torch.linalg.vector_norm(corners.amax(0) - corners.amin(0)).clamp(min=1.0)
    return diagonal.expand(2)


def _place_one(person: Subject, settings: HumanSettings) -> _Placed:
    start = torch.zeros(4, dtype=torch.float64)
    x, by_keypoints, problem, chamfer = start, start, None, None
    grounded = True
    seen = torch.zeros(len(person.vertices), dtype=torch.bool)
    if not bool(torch.isfinite(person.vertices).all()):
        problem = "the body is not finite, it was left where it is"
    else:
        x, problem = _fit_keypoints(person, settings)
        by_keypoints = x
        if settings.chamfer_weight > 0:
            x, seen, chamfer, grounded = _fit_points(person, x, settings)
            if not grounded:
                person = person._replace(soles=person.soles[:0])
            if chamfer is None and problem is None:
                problem = (
                    f"{len(person.points)} points and {int(seen.sum())} camera-facing vertices of the person, "
                    f"{settings.min_points} of each are needed: placed by keypoints alone"
                )
        x = _bounded(person, x, seen if chamfer is not None else None, settings)
        if not bool(torch.isfinite(x).all()) or float((person.vertices[:, 2] + x[2]).median()) < NEAREST_M:
            x = by_keypoints = start
            problem = "no translation in front of the camera fits, the body was left where it is"
    foot = float(height(person.soles + x[:3], person.plane[:3], person.plane[3]).min()) if person.stands else None
    offset = math.exp(float(x[3]))
    diagnostics = {
        "keypoints": len(person.keypoints),
        "points": len(person.points),
        "facing_vertices": int(seen.sum()),
        "reprojection_px": (_reprojection_px(person, start), _reprojection_px(person, x)),
        "chamfer_m": chamfer,
        "losses": _losses(person, x, seen if chamfer is not None else None, settings),
        "moved_m": float(torch.linalg.vector_norm(x[:3])),
        "depth_offset": offset,
        "foot_height_m": foot,
        "grounded": grounded,
        "problem": problem,
    }
    return _Placed(x[:3], offset, grounded, diagnostics, by_keypoints[:3])


def _losses(person: Subject, x: Tensor, seen: Tensor | None, settings: HumanSettings) -> dict[str, dict[str, float]]:
    """Each term of Eq. 3 that took part, where the body was and at x; of the vertices ``seen`` at last."""
    terms: dict[str, Term] = {}
    if not bool(torch.isfinite(person.vertices).all()):
        return {}
    if len(person.keypoints) >= FEWEST_KEYPOINTS:
        terms["reprojection"] = Reprojection(person, settings)
    if seen is not None:
        terms["chamfer"] = Chamfer(person, seen, settings)
        if _is_free(person, settings):
            terms["floor"] = Standing(person, settings)
    ends = {"start": torch.zeros_like(x), "end": x}
    told = {name: {end: loss(term, at) for end, at in ends.items()} for name, term in terms.items()}
    if "reprojection" in told and settings.reprojection_loss == "released":
        weight = settings.reprojection_weight
        told["reprojection"] = {
            e: weight * float(reprojection_loss(person, at[:3], settings)) for e, at in ends.items()
        }
    return told


def _is_free(person: Subject, settings: HumanSettings) -> bool:
    """Whether the person's points may be nearer or farther than the scene says."""
    return settings.solver != "adam_lbfgs" and person.stands and settings.depth_offset_sigma > 0


def _fit_keypoints(person: Subject, settings: HumanSettings) -> tuple[Tensor, str | None]:
    """Eq. 2: x, and what stood in the way."""
    if len(person.keypoints) < FEWEST_KEYPOINTS:
        return torch.zeros(4, dtype=torch.float64), (
            f"{len(person.keypoints)} keypoints have confidence {settings.min_confidence:g} or more, "
            f"{FEWEST_KEYPOINTS} are needed to place a body by them"
        )
    if settings.solver == "adam_lbfgs":
        return adam(person, settings), None
    return descend([Reprojection(person, settings)], closed_form(person), (0, 1, 2), settings.iterations), None


def _bounded(person: Subject, x: Tensor, seen: Tensor | None, settings: HumanSettings) -> Tensor:
    """x, or a place near it where the keypoints fit no worse than they came, if the settings want it."""
    if not settings.keypoint_bound or len(person.keypoints) < FEWEST_KEYPOINTS:
        return x
    came, term = torch.zeros_like(x), Reprojection(person, settings)
    most = loss(term, came), _reprojection_px(person, came) or 0.0

    def fits(at: Tensor) -> bool:
        return loss(term, at) <= most[0] and (_reprojection_px(person, at) or 0.0) <= most[1]

    # Of as many pairs as Eq. 4 has; without points any number leads to the keypoints alone.
    pairs = 1 if seen is None else int(seen.sum()) + len(person.points)
    return within_keypoints(person, x, settings.chamfer_weight * pairs, settings, fits)


def _reprojection_px(person: Subject, x: Tensor) -> float | None:
    """Median distance of the used keypoints, px."""
    if not len(person.keypoints):
        return None
    uv = project(person.landmarks + x[:3], person.K)
    return float(torch.linalg.vector_norm(uv - person.keypoints, dim=-1).median())


def _camera_facing(person: Subject, x: Tensor, settings: HumanSettings) -> Tensor:
    """(V,) bool: V_cf of Eq. 4, turned to the camera and projected into the person's own mask."""
    moved = person.vertices + x[:3]
    if settings.visibility == "released":
        turned = faces_optical_axis(person.normals, settings.facing_deg)
    else:
        turned = facing(person.normals, moved, settings.facing_deg)
    turned = turned & (moved[:, 2] > NEAREST_M)
    return turned & person.outer & inside_mask(project(moved, person.K), person.mask)


def _is_elsewhere(person: Subject, x: Tensor, terms: list[Term], settings: HumanSettings) -> bool:
    """Whether the person's points and keypoints, tied to the scene, put both feet well above the floor."""
    if not settings.stand_reach_m or not _is_free(person, settings):
        return False
    tied = descend(terms, x, (0, 1, 2), settings.iterations)
    lower = float(height(person.soles + tied[:3], person.plane[:3], person.plane[3]).min())
    away = float((person.vertices[:, 2] + tied[2]).median())
    return lower > min(settings.stand_reach_m, settings.stand_reach_share * away)


def _fit_points(
    person: Subject, x: Tensor, settings: HumanSettings
) -> tuple[Tensor, Tensor, tuple[float, float] | None, bool]:
    """Eq. 3-4: x, the camera-facing vertices, the median distance before and after, None where it was not done, and
    whether grounded.

    The camera-facing vertices are picked again once, where the body has moved.
    """
    seen = _camera_facing(person, x, settings)
    if len(person.points) < settings.min_points or int(seen.sum()) < settings.min_points:
        return x, seen, None, True
    chamfer = Chamfer(person, seen, settings)
    before = chamfer.median(x)
    if settings.solver == "adam_lbfgs":
        x = lbfgs(person, x, chamfer, settings)
        return x, seen, (before, chamfer.median(x)), True
    others: list[Term] = [Reprojection(person, settings)] if len(person.keypoints) >= FEWEST_KEYPOINTS else []
    grounded = not _is_elsewhere(person, x, [chamfer, *others], settings)
    free = grounded and _is_free(person, settings)
    if free:
        others.insert(0, Standing(person, settings))
    for _ in range(_ROUNDS):
        last = x
        x = descend([chamfer, *others], x, (0, 1, 2, 3) if free else (0, 1, 2), settings.iterations)
        again = _camera_facing(person, x, settings)
        if float((x - last).abs().max()) < _MOVED_M or int(again.sum()) < settings.min_points:
            break
        seen, chamfer = again, Chamfer(person, again, settings)
    return x, seen, (before, chamfer.median(x)), grounded
