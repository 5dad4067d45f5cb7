"""Numbers for the self-checks of each person, from the final bodies and their contact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

from physic_core.engine.contact.parts import SEAT, kind_of_part
from physic_core.engine.joint.solve import DEEP_M
from physic_core.engine.limbs import observed_parts
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.visibility import depth_order_violations
from physic_core.pipeline.measures import (
    UpAndFloor,
    carrying_vertices,
    clearance,
    depth_ratio,
    sole_height,
    support_gap,
    visible_share,
)
from physic_core.pipeline.silhouettes import PhotoEvidence, compare_silhouettes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torch import Tensor

    from physic_core.engine.contact.problem import ContactResult
    from physic_core.engine.joint.problem import JointProblem, JointResult
    from physic_core.types import Support


def measure_people(problem: JointProblem, result: JointResult, found: ContactResult) -> list[dict[str, float | None]]:
    """Measure how each person agrees with scene, floor and photo; an empty mapping for non-finite vertices.

    Args:
        problem: of stage 3, with the final scene.
        result: of stage 3.
        found: contact of the same people.
    """
    model, scale = problem.model, result.scene_scale
    ground = UpAndFloor(result.vertices.new_tensor([0.0, -1.0, 0.0]), None)
    if problem.floor_normal is not None:
        ground = UpAndFloor(problem.floor_normal.to(ground.up), problem.floor_offset * scale)
    soles = model.soles
    outward = vertex_normals(result.vertices, model.faces)
    may_carry = carrying_vertices(model, found.parts).expand_as(found.contact)
    if found.probability is not None:
        may_carry = may_carry & observed_parts(model.part_names, problem.observed_anywhere)[:, model.part_of_vertex]
    silhouettes = compare_silhouettes(result.vertices, model.faces, _photo_evidence(problem, scale))
    ratios = depth_ratios(problem, result)
    deep = deep_shares(result, found.give)
    order = _depth_order(problem, result)
    reversed_depth = reversed_depths(result.joints[:, 0, 2].tolist(), ratios)
    measured: list[dict[str, float | None]] = [{} for _ in ratios]
    for i, (body, normals, support) in enumerate(zip(result.vertices, outward, found.supports, strict=True)):
        if support is None:
            continue
        distance, mask = found.distance[i], problem.masks[i]
        seen = visible_share(body, normals, model.faces, model.outer, mask, problem.K) if bool(mask.any()) else None
        measured[i] = {
            **_balance(support),
            "seat_missing": _missing_seat(support, found, i),
            **silhouettes[i],
            **_known("depth_offset", result.depth_offset[i]),
            **_known("reprojection_share", result.reprojection_share[i]),
            "depth_order_share": order[i],
            "clearance_m": clearance(body, distance, ground),
            "sole_height_m": sole_height(body, soles, ground),
            "seen_share": seen,
            "support_gap_m": support_gap(body, normals, may_carry[i], distance, ground),
        }
        if problem.human_depth is not None:
            measured[i] |= {"depth_ratio": ratios[i], "reversed_depth": reversed_depth[i]}
        if bool(result.surface_share[i].any()):
            measured[i]["penetration_share"] = deep[i]
    return measured


def _known(name: str, value: Tensor) -> dict[str, float | None]:
    """Return a number by its name; empty if it is NaN."""
    return {} if bool(torch.isnan(value)) else {name: float(value)}


def _depth_order(problem: JointProblem, result: JointResult) -> list[float]:
    """Return the share of each person's vertices that are in front of a person who occludes them in the photo."""
    finite = torch.isfinite(result.vertices).flatten(1).all(1)
    vertices = result.vertices[finite]
    behind = depth_order_violations(vertices, project(vertices, problem.K), problem.masks[finite])
    shares: list[float] = vertices.new_zeros(len(finite)).index_put((finite,), behind.amax(0)).tolist()
    return shares


def reversed_depths(depths: Sequence[float], ratios: Sequence[float | None]) -> list[float | None]:
    """Return by how much depth map and bodies disagree on which person of a pair is in front.

    Args:
        depths: of the pelvises, metres.
        ratios: depth of the photo over that of each body, None where it cannot be measured.

    Returns:
        Per person, the smaller of the two differences of log depth, maximised over the other people; None
        if no other depth is known, 0 for a person alone.
    """
    found = []
    known = [(z, z * ratio) if ratio and z > 0 else None for z, ratio in zip(depths, ratios, strict=True)]
    for i, own in enumerate(known):
        others = [other for j, other in enumerate(known) if other is not None and j != i]
        worst = 0.0 if len(known) == 1 else None
        for other in others if own is not None else []:
            by_body, by_map = (math.log(b / a) for a, b in zip(own or (), other, strict=True))
            worst = max(worst or 0.0, min(abs(by_body), abs(by_map)) if by_body * by_map < 0 else 0.0)
        found.append(worst)
    return found


def deep_shares(result: JointResult, give: Tensor) -> list[float]:
    """Return the share of each person's visible surface over 3 cm below scene and floor, dented by ``give`` (N, V)."""
    deep = result.depth_inside > DEEP_M + give.to(result.depth_inside)
    shares: list[float] = (result.surface_share * deep).sum(1).tolist()
    return shares


def depth_ratios(problem: JointProblem, result: JointResult) -> list[float | None]:
    """Return the depth of the photo over that of each body; None where it cannot be measured."""
    model = problem.model
    if problem.human_depth is None:
        return [None] * len(problem)
    depth, outward = problem.human_depth * result.scene_scale, vertex_normals(result.vertices, model.faces)
    return [
        depth_ratio(body, normals, model.outer, mask, problem.K, depth) if bool(torch.isfinite(body).all()) else None
        for body, normals, mask in zip(result.vertices, outward, problem.masks, strict=True)
    ]


def _balance(support: Support) -> dict[str, float | None]:
    """Return the distance of the centre of mass from the supports, metres, and whether a hidden one is assumed."""
    outside = support.outside_m
    return {
        "balance_m": None if outside is None else max(0.0, outside),
        "assumed_support": float(bool(support.hidden)),
    }


def _missing_seat(support: Support, found: ContactResult, person: int) -> float | None:
    """Return the probability that a person sits; 0 if a seat was found, None if the method estimates none."""
    if not found.parts:
        return None
    on = (one for one in support.contacts if kind_of_part(one.part) == SEAT and one.partner.kind != "hidden")
    return 0.0 if any(on) else float(found.parts[SEAT][person])


def _photo_evidence(problem: JointProblem, scale: float) -> PhotoEvidence:
    """Return masks and depths of the problem, with the final scale of the scene."""
    scene, photo = problem.scene_depth, problem.human_depth
    return PhotoEvidence(
        masks=problem.masks,
        scene_depth=None if scene is None else scene * scale,
        photo_depth=None if photo is None else photo * scale,
        K=problem.K,
    )
