"""The second half of the method: the engine's three stages on what the estimators said, then the contact map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import torch

from physic_core.body.joints import joint_pair
from physic_core.body.landmarks import known_keypoints
from physic_core.body.parameters import parameters_from_rotations, rotations_from_parameters
from physic_core.engine.contact import contact_map, contact_surface
from physic_core.engine.joint.final_scene import is_furniture, settled, without_floor
from physic_core.engine.joint.limbs import confirmed_joints, observed_parts, placing_keypoints
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.released_reprojection import released_keypoint_weights
from physic_core.engine.joint.released_visibility import mean_face_normals
from physic_core.engine.joint.solve import optimize
from physic_core.engine.placement.human_points import align_original, human_points, place, placed_original
from physic_core.engine.placement.left_right import tell_sides
from physic_core.engine.scene.build import alignment_diagnostics, build_scene
from physic_core.geometry.camera import project
from physic_core.geometry.free_space import fronts, in_free_space
from physic_core.geometry.tensors import tensor
from physic_core.geometry.visibility import vertex_normals
from physic_core.pipeline.estimate import feet_pixels
from physic_core.pipeline.measures import depth_ratio, seen_share, support_gap
from physic_core.types import BodyParameters, CameraTrust, Intrinsics, Plane, Scene
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.engine.joint.problem import JointResult
    from physic_core.engine.placement.place import Placement
    from physic_core.engine.scene.build import SceneState
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Evidence
    from physic_core.pipeline.stages import Stages
    from physic_core.types import BoolArray, FloatArray

__all__ = ["Solution", "solve"]

_ANKLES = joint_pair("ankle")


@dataclass(frozen=True)
class Solution(ShortRepr):
    """What the engine found, metres, camera frame of ``intrinsics``; N people.

    Attributes:
        intrinsics: the camera of all projections.
        scene: without people, its final scale applied.
        parameters: of N bodies.
        vertices: (N, V, 3) float32.
        joints: (N, 55, 3) float32.
        contact: (N, V) bool.
        distance: (N, V) float32, signed, inf where nothing is near.
        people: per person, name -> number, for diagnosis and reports.
        failures: per person, why stage 3 left them at their start, "" where it did not.
        diagnostics: numbers by stage.
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


def solve(evidence: Evidence, settings: EngineSettings, model: BodyModel, stages: Stages) -> Solution:
    """Run the engine where ``model`` lies.

    The pipeline keeps that on the CPU, where nearest points and ray casts run in any case.
    """
    # Eighty steps of L-BFGS multiply a rounding error by millions: float32 would show each CPU's kernels in the result.
    model = model.to(dtype=torch.float64)
    with stages.engine("scene"):
        scene = _stage_scene(evidence, settings)
    with stages.engine("placement"):
        problem, placement = _stage_placement(evidence, scene, settings, model)
        if is_furniture(scene, problem):
            scene = without_floor(scene)
            problem, placement = _stage_placement(evidence, scene, settings, model)
    with stages.engine("joint optimisation"):
        # Where nothing of the background agrees, nobody's own depth is known, and the warning says so.
        blind = problem.human_depth is None
        result = optimize(problem, replace(settings.joint, depth_weight=0.0) if blind else settings.joint)
    with stages.engine("contact"):
        scene, problem = settled(scene, problem, result, tensor(evidence.hole), settings.scene)
        return _describe(evidence, scene, problem, placement, result, settings)


def _stage_scene(evidence: Evidence, settings: EngineSettings) -> SceneState:
    height, width = evidence.hole.shape
    metric, pointmap = evidence.depth.intrinsics, evidence.scene.intrinsics
    keep = evidence.camera_given or (pointmap is not None and (metric is None or _trust(pointmap) > _trust(metric)))
    if pointmap is not None and metric is not None and _trust(pointmap) < _trust(metric):
        pointmap = None
    if keep and metric is not None and metric.known:
        metric = None  # its depth is what it is, whatever camera it is used with
    return build_scene(
        tensor(evidence.scene.points),
        tensor(evidence.scene.valid),
        evidence.scene.unknown,
        tensor(evidence.depth.depth),
        K=torch.from_numpy(evidence.intrinsics.matrix) if keep else None,
        K_metric=None if metric is None else torch.from_numpy(metric.matrix),
        K_pointmap=None if pointmap is None else torch.from_numpy(pointmap.matrix),
        floor_mask=None if evidence.people.floor is None else tensor(evidence.people.floor),
        hole=tensor(evidence.hole),
        feet_px=tensor(feet_pixels(evidence.keypoints, height, width)),
        settings=settings.scene,
    )


def _trust(camera: Intrinsics) -> int:
    """Who measured a camera goes before who estimated it, and both before who only guesses."""
    return int(camera.known) - int(camera.guessed)


def _camera_source(K: Tensor, evidence: Evidence) -> tuple[str, CameraTrust]:
    for camera in (evidence.intrinsics, evidence.depth.intrinsics):
        if camera is not None and torch.equal(K, torch.from_numpy(camera.matrix)):
            return camera.source, camera.trust
    return "point map and metric depth", CameraTrust.ESTIMATED


def _stage_placement(
    evidence: Evidence, scene: SceneState, settings: EngineSettings, model: BodyModel
) -> tuple[JointProblem, dict[str, Any]]:
    device, dtype = model.device, model.dtype
    masks = tensor(evidence.people.masks)
    original = tensor(evidence.original.points)
    known = tensor(evidence.original.valid)
    alignment = align_original(
        original,
        known,
        evidence.original.unknown,
        scene.points,
        scene.valid,
        tensor(evidence.hole),
        settings.human,
        far=settings.human.far_m,
    )
    aligned = placed_original(original, alignment, scene.K)
    points = [human_points(aligned, known, mask, settings.human) for mask in masks]

    parameters = evidence.bodies.parameters
    rotations = rotations_from_parameters(parameters, device, dtype)
    betas = tensor(parameters.betas).to(device, dtype)
    expression = tensor(parameters.expression).to(device, dtype)
    transl = tensor(parameters.transl).to(device, dtype)
    told = known_keypoints(evidence.keypoints)
    keypoints = tensor(told.points).to(device, dtype)
    confidence = tensor(told.confidence).to(device, dtype)
    body = model(rotations, betas, transl, expression)
    landmarks = model.landmarks(body, told.skeleton)
    is_released = settings.human.reprojection_loss == "released"
    placing = list(range(keypoints.shape[1])) if is_released else placing_keypoints(told.skeleton, keypoints.shape[1])
    normals_of = mean_face_normals if settings.human.visibility == "released" else vertex_normals
    outward = normals_of(body.vertices, model.faces)
    K = scene.K.to(device, dtype)

    def placed_by(keypoints: Tensor, confidence: Tensor) -> tuple[Placement, Tensor]:
        observed = _observed(evidence, device) | confirmed_joints(
            told.skeleton, keypoints, confidence, masks.to(device), settings.human.seen_confidence
        )
        weight = confidence
        if is_released:
            weight = released_keypoint_weights(told.skeleton, keypoints, confidence, masks.to(device))
        placement = place(
            body.vertices,
            outward,
            landmarks[:, placing],
            transl,
            keypoints[:, placing],
            weight[:, placing],
            K,
            points,
            masks,
            settings.human,
            outer=model.outer,
            floor_normal=scene.floor_normal,
            floor_offset=scene.floor_offset,
            soles=torch.cat([model.contact_sets["left_sole"], model.contact_sets["right_sole"]]),
            feet_seen=observed[:, _ANKLES].any(1),
        )
        return placement, observed

    placed, observed = placed_by(keypoints, confidence)
    moved = landmarks + (placed.transl.to(device, dtype) - transl)[:, None]
    sides = tell_sides(told.skeleton, keypoints, confidence, project(moved, K), settings.human.mixed_sides_deg)
    if any(sides.exchanged):
        keypoints = keypoints.take_along_dim(sides.order[..., None], 1)
        confidence = confidence.take_along_dim(sides.order, 1)
        placed, observed = placed_by(keypoints, confidence)
    agree = alignment.inlier_share > 0
    depth = torch.where(known & torch.isfinite(aligned).all(-1), aligned[..., 2], torch.nan)
    problem = JointProblem(
        model=model,
        rotations0=rotations,
        betas0=betas,
        expression0=expression,
        transl0=placed.transl.to(device, dtype),
        keypoints=keypoints,
        keypoint_confidence=confidence,
        skeleton=told.skeleton,
        K=K,
        masks=masks.to(device),
        scene_points=scene.points[scene.valid].to(device, dtype),
        scene_normals=scene.normals[scene.valid].to(device, dtype),
        contact_probability=tensor(evidence.contact.probability).to(device, dtype),
        observed=observed,
        scene_depth=scene.depth.to(device, dtype),
        floor_normal=None if scene.floor_normal is None else scene.floor_normal.to(device, dtype),
        floor_offset=scene.floor_offset,
        floor_points=scene.floor_points.to(device, dtype),
        human_depth=depth.to(device, dtype) if agree else None,
        human_points=tuple(p.to(device, dtype) for p in points) if agree else None,
        scale_sigma=evidence.depth.scale_sigma,
        grounded=placed.grounded.to(device),
        estimated_transl=transl,
        keypoint_transl=placed.keypoint_transl.to(device, dtype),
    )
    people = [{**d, "exchanged": list(x)} for d, x in zip(placed.diagnostics, sides.exchanged, strict=True)]
    diagnostics = {"alignment": alignment_diagnostics(alignment), "people": people}
    return problem, diagnostics


def _observed(evidence: Evidence, device: torch.device) -> Tensor:
    if evidence.bodies.observed is None:
        return torch.ones((len(evidence.people), 55), dtype=torch.bool, device=device)
    return tensor(evidence.bodies.observed).to(device)


def _describe(
    evidence: Evidence,
    scene: SceneState,
    problem: JointProblem,
    placement: dict[str, Any],
    result: JointResult,
    settings: EngineSettings,
) -> Solution:
    s = result.scene_scale
    K, (height, width) = scene.K, evidence.hole.shape
    floor = None
    if scene.floor_normal is not None:
        floor = Plane(scene.floor_normal.numpy(), float(scene.floor_offset * s))
    contact, distance, measured = _meet_scene(problem, result, settings)
    people = tuple(
        {**{f"placement_{k}": v for k, v in start.items()}, **end, **more}
        for start, end, more in zip(placement["people"], result.diagnostics, measured, strict=True)
    )
    return Solution(
        intrinsics=Intrinsics(
            float(K[0, 0]),
            float(K[1, 1]),
            float(K[0, 2]),
            float(K[1, 2]),
            width,
            height,
            *_camera_source(K, evidence),
        ),
        scene=Scene(
            points=(scene.points * s).float().numpy(),
            normals=scene.normals.float().numpy(),
            colors=evidence.empty,
            valid=scene.valid.numpy(),
            floor=floor,
            floor_points=(scene.floor_points * s).float().numpy(),
            scale=s,
            scale_sigma=evidence.depth.scale_sigma,
        ),
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


def _meet_scene(
    problem: JointProblem, result: JointResult, settings: EngineSettings
) -> tuple[Tensor, Tensor, list[dict[str, float | None]]]:
    """Contact (N, V) bool, signed distance (N, V), and the measures of each person.

    People with non-finite vertices get no contacts and infinite distance.
    """
    s, model, reach = result.scene_scale, problem.model, settings.contact.reach_m
    whole = torch.isfinite(result.vertices).flatten(1).all(1)
    rows = whole.nonzero(as_tuple=True)[0]
    contact = torch.zeros(result.vertices.shape[:2], dtype=torch.bool, device=result.vertices.device)
    distance = torch.full_like(result.vertices[..., 0], torch.inf)
    measured: list[dict[str, float | None]] = [{} for _ in whole]
    if not len(rows):
        return contact, distance, measured
    vertices = result.vertices[rows]
    outward = vertex_normals(vertices, model.faces)
    may_touch = model.outer.expand(len(rows), -1)
    if settings.contact.observed:
        may_touch = may_touch & observed_parts(model.part_names, problem.observed[rows])[:, model.part_of_vertex]
    plane = None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * s)
    scene, ground = contact_surface(problem, vertices, s, settings)
    free = None
    if settings.joint.free_space and problem.scene_depth is not None:
        free = in_free_space(vertices / s, fronts(problem.scene_depth), problem.K)
    contact[rows], distance[rows] = contact_map(vertices, scene, ground, may_touch, settings.contact, outward, free)
    up, height = plane or (vertices.new_tensor([0.0, -1.0, 0.0]), None)
    for row, (i, body, normals) in enumerate(zip(rows.tolist(), vertices, outward, strict=True)):
        seen = problem.masks[i]
        measured[i] = {
            "seen_share": seen_share(body, normals, model.faces, model.outer, seen, problem.K),
            "support_gap_m": support_gap(
                body, result.joints[i], normals, may_touch[row], distance[i], up.to(body), height, reach
            ),
        }
        if problem.human_depth is not None:
            depth = problem.human_depth * s
            measured[i]["depth_ratio"] = depth_ratio(body, normals, model.outer, seen, problem.K, depth)
    return contact, distance, measured
