"""Result of the engine as NumPy arrays: scaled scene, posed people, contact map and measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from physic_core.body.joints import NUM_JOINTS
from physic_core.body.parameters import parameters_from_rotations
from physic_core.engine.assumed_support import PosedPerson, assumed_hold, assumed_seat
from physic_core.engine.contact import SEARCH_RADIUS_M, contact_map, contact_surfaces
from physic_core.engine.joint.limbs import observed_parts
from physic_core.geometry.free_space import front_depth, in_free_space
from physic_core.geometry.visibility import vertex_normals
from physic_core.pipeline.measures import clearance, depth_ratio, sole_height, support_gap, visible_share
from physic_core.pipeline.silhouettes import PhotoEvidence, compare_silhouettes
from physic_core.types import BodyParameters, CameraTrust, Intrinsics, Plane, Scene
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.engine.joint.problem import JointProblem, JointResult
    from physic_core.engine.scene.build import SceneState
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.types import BoolArray, FloatArray

__all__ = ["Solution", "assemble_solution", "scene_alone"]


@dataclass(frozen=True)
class Solution(ShortRepr):
    """Result of the engine for N people, in the camera frame of ``intrinsics``, metres.

    Attributes:
        intrinsics: the camera of all projections.
        scene: without people, its final scale applied.
        parameters: of N bodies.
        vertices: (N, V, 3) float32.
        joints: (N, 55, 3) float32.
        contact: (N, V) bool.
        distance: (N, V) float32, signed, metres, negative inside; inf beyond the search radius.
        people: per person, measured numbers by name.
        failures: per person, reason why stage 3 left pose and position unchanged, or "".
        diagnostics: numbers by stage; without people of the scene alone.
    """

    intrinsics: Intrinsics
    scene: Scene
    parameters: BodyParameters
    vertices: FloatArray
    joints: FloatArray
    contact: BoolArray
    distance: FloatArray
    people: tuple[Mapping[str, Any], ...]
    failures: tuple[str, ...]
    diagnostics: Mapping[str, Any]


def assemble_solution(
    estimates: Estimates,
    scene: SceneState,
    problem: JointProblem,
    placement: Mapping[str, Any],
    result: JointResult,
    settings: EngineSettings,
) -> Solution:
    """Convert the results of the engine to arrays and diagnostics.

    Args:
        estimates: of the estimators.
        scene: final scene before its scale is applied.
        problem: of stage 3, with that scene.
        placement: diagnostics of stage 2: "alignment", and one mapping per person under "people".
        result: of stage 3.
        settings: of the engine.
    """
    s = result.scene_scale
    contact, distance, measured = measure_contacts(problem, result, settings)
    people = tuple(
        {**{f"placement_{k}": v for k, v in start.items()}, **end, **more}
        for start, end, more in zip(placement["people"], result.diagnostics, measured, strict=True)
    )
    return Solution(
        intrinsics=_intrinsics(scene.K, estimates),
        scene=_scene(scene, s, estimates),
        parameters=parameters_from_rotations(result.rotations, result.betas, problem.expression0, result.transl),
        vertices=result.vertices.float().cpu().numpy(),
        joints=result.joints.float().cpu().numpy(),
        contact=contact.cpu().numpy(),
        distance=distance.float().cpu().numpy(),
        people=people,
        failures=result.failures,
        diagnostics={
            "scene": dict(scene.diagnostics),
            "placement": {"alignment": placement["alignment"]},
            "joint": {
                "losses": {name: {"start": a, "end": b} for name, (a, b) in result.losses.items()},
                "scene_scale": s,
                "steps": result.steps,
                "evaluations": result.evaluations,
            },
        },
    )


def scene_alone(estimates: Estimates, scene: SceneState, model: BodyModel, scale_sigma: float | None) -> Solution:
    """Return the solution of a photo without people: the scene of stage 1, and arrays for N = 0 people."""
    rotations, betas, transl = model.zero_pose(0)
    expression = betas.new_zeros(0, model.num_expression)
    return Solution(
        intrinsics=_intrinsics(scene.K, estimates),
        scene=replace(_scene(scene, 1.0, estimates), scale_sigma=scale_sigma),
        parameters=parameters_from_rotations(rotations, betas, expression, transl),
        vertices=np.zeros((0, model.num_vertices, 3), np.float32),
        joints=np.zeros((0, NUM_JOINTS, 3), np.float32),
        contact=np.zeros((0, model.num_vertices), bool),
        distance=np.zeros((0, model.num_vertices), np.float32),
        people=(),
        failures=(),
        diagnostics={"scene": dict(scene.diagnostics)},
    )


def _intrinsics(K: Tensor, estimates: Estimates) -> Intrinsics:
    height, width = estimates.hole.shape
    fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    return Intrinsics(fx, fy, cx, cy, width, height, *_camera_source(K, estimates))


def _scene(scene: SceneState, scale: float, estimates: Estimates) -> Scene:
    """Convert the scene of the engine, multiplied by the scale of stage 3."""
    floor = None
    if scene.floor_normal is not None:
        floor = Plane(scene.floor_normal.numpy(), float(scene.floor_offset * scale))
    return Scene(
        points=(scene.points * scale).float().numpy(),
        normals=scene.normals.float().numpy(),
        colors=estimates.inpainted,
        valid=scene.valid.numpy(),
        floor=floor,
        floor_points=(scene.floor_points * scale).float().numpy(),
        scale=scale,
        scale_sigma=estimates.depth.scale_sigma,
    )


def _camera_source(K: Tensor, estimates: Estimates) -> tuple[str, CameraTrust, float | None]:
    for camera in (estimates.intrinsics, estimates.depth.intrinsics):
        if camera is not None and torch.equal(K, torch.from_numpy(camera.matrix)):
            return camera.source, camera.trust, camera.focal_sigma
    return "point map and metric depth", CameraTrust.ESTIMATED, None


def measure_contacts(
    problem: JointProblem, result: JointResult, settings: EngineSettings
) -> tuple[Tensor, Tensor, list[dict[str, float | None]]]:
    """Compute contact (N, V) bool, signed distance (N, V) metres, and the measures of each person.

    People with non-finite vertices get no contacts and infinite distance.
    """
    s, model = result.scene_scale, problem.model
    finite = torch.isfinite(result.vertices).flatten(1).all(1)
    rows = finite.nonzero(as_tuple=True)[0]
    contact = torch.zeros(result.vertices.shape[:2], dtype=torch.bool, device=result.vertices.device)
    distance = torch.full_like(result.vertices[..., 0], torch.inf)
    measured: list[dict[str, float | None]] = [{} for _ in finite]
    if not len(rows):
        return contact, distance, measured
    vertices = result.vertices[rows]
    outward = vertex_normals(vertices, model.faces)
    may_touch = model.outer.expand(len(rows), -1)
    if settings.contact.observed:
        may_touch = may_touch & observed_parts(model.part_names, problem.observed[rows])[:, model.part_of_vertex]
    may_touch = may_touch & ~problem.feet_in_air()[rows]
    plane = None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * s)
    scene, ground = contact_surfaces(problem, vertices, s, settings)
    free = None
    if settings.joint.energy_options.free_space and problem.scene_depth is not None:
        free = in_free_space(vertices / s, front_depth(problem.scene_depth), problem.K)
    contact[rows], distance[rows] = contact_map(vertices, scene, ground, may_touch, settings.contact, free)
    up, height = plane or (vertices.new_tensor([0.0, -1.0, 0.0]), None)
    up, soles = up.to(vertices), torch.cat([model.contact_sets["left_sole"], model.contact_sets["right_sole"]])
    silhouettes = compare_silhouettes(result.vertices, model.faces, _photo_evidence(problem, s))
    for row, (i, body, normals) in enumerate(zip(rows.tolist(), vertices, outward, strict=True)):
        seen = problem.masks[i]
        if settings.contact.assume_supports:
            posed = PosedPerson(body, normals, result.joints[i], result.rotations[i])
            lifted = problem.lifted_feet[i] if problem.lifted_feet is not None else torch.zeros(2, dtype=torch.bool)
            held = assumed_hold(model, contact[i], problem.contact_probability[i], lifted)
            seat = assumed_seat(model, posed, contact[i], may_touch[row] & ~lifted.all(), up)
            contact[i] |= held | seat
            measured[i] = {"assumed_seat": float(seat.any()), "assumed_hold": float(held.any())}
        measured[i] |= {
            **silhouettes[i],
            "clearance_m": clearance(body, distance[i], up, height),
            "sole_height_m": sole_height(body, soles, up, height),
            "seen_share": visible_share(body, normals, model.faces, model.outer, seen, problem.K),
            "support_gap_m": support_gap(
                body, result.joints[i], normals, may_touch[row], distance[i], up, height, SEARCH_RADIUS_M
            ),
        }
        if problem.human_depth is not None:
            depth = problem.human_depth * s
            measured[i]["depth_ratio"] = depth_ratio(body, normals, model.outer, seen, problem.K, depth)
    return contact, distance, measured


def _photo_evidence(problem: JointProblem, scale: float) -> PhotoEvidence:
    """Return masks and depths of the problem, with the final scale of the scene."""
    scene, photo = problem.scene_depth, problem.human_depth
    return PhotoEvidence(
        masks=problem.masks,
        scene_depth=None if scene is None else scene * scale,
        photo_depth=None if photo is None else photo * scale,
        K=problem.K,
    )
