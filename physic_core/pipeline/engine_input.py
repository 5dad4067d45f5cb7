"""Inputs of the four stages of the engine, from the estimates and the results of earlier stages."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.body.bones import rotations_from_parameters
from physic_core.body.joints import NUM_JOINTS
from physic_core.body.landmarks import keypoints_on_body
from physic_core.engine.contact.problem import ContactInput
from physic_core.engine.contact.scene_parts import ClassifiedPoints
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.scene.method import Cameras
from physic_core.engine.scene.solve import SceneInput
from physic_core.engine.state import State
from physic_core.geometry.camera import project
from physic_core.geometry.tensors import select_pixels, tensor, tensors
from physic_core.geometry.visibility import inside_mask
from physic_core.pipeline.floor_and_scale import floor_evidence
from physic_core.pipeline.person_measures import depth_ratios

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.engine.contact.method import ContactMethod
    from physic_core.engine.contact.objects import HeldObjects
    from physic_core.engine.joint.problem import JointResult
    from physic_core.engine.scene.state import SceneState
    from physic_core.engine.state import Estimates
    from physic_core.types import FloatArray, Intrinsics


def scene_input(estimates: Estimates) -> SceneInput:
    """Return the input of stage 1."""
    scene, people = estimates.scene, estimates.people
    evidence = floor_evidence(people, estimates.hole, estimates.keypoints, estimates.intrinsics)
    points, valid, depth = tensors(scene.points, scene.valid, estimates.depth.depth)
    floor = replace(evidence, found=estimates.floor)
    return SceneInput(points, valid, scene.unknown, depth, _cameras(estimates), floor)


def initial_state(estimates: Estimates, model: BodyModel, scene: SceneState) -> State:
    """Return the people as estimated, in the type and on the device of the model.

    Args:
        estimates: of the photo.
        model: body model of the people.
        scene: of stage 1.
    """
    bodies, detected = estimates.bodies, keypoints_on_body(estimates.keypoints)
    masks, observed = tensor(estimates.people.masks), bodies.observed

    def own(array: FloatArray) -> Tensor:
        return tensor(array).to(model.device, model.dtype)

    if observed is None:
        observed = np.ones((len(masks), NUM_JOINTS), bool)
    return State(
        model=model,
        skeleton=detected.joint_set,
        keypoints=own(detected.points),
        keypoint_confidence=own(detected.confidence),
        masks=masks.to(model.device),
        observed=tensor(observed).to(model.device),
        contact_prior=own(estimates.contact.probability),
        rotations=rotations_from_parameters(bodies.parameters, model.device, model.dtype),
        betas=own(bodies.parameters.betas),
        expression=own(bodies.parameters.expression),
        transl=own(bodies.parameters.transl),
        rotation_sigma=None if bodies.rotation_sigma is None else own(bodies.rotation_sigma),
        stance=estimates.stance,
        scene=scene,
        scale_sigma=estimates.depth.scale_sigma,
        views=estimates.views,
    )


def _cameras(estimates: Estimates) -> Cameras:
    """Return the cameras for stage 1: known ones before estimated ones before guessed ones."""
    metric = estimates.depth.intrinsics
    pointmap = estimates.scene.intrinsics
    keep = estimates.camera_given or (
        pointmap is not None and (metric is None or _trust(pointmap) > _trust(metric))
    )
    if pointmap is not None and metric is not None and _trust(pointmap) < _trust(metric):
        pointmap = None
    if keep and metric is not None and metric.known:
        metric = None  # its depth does not depend on the camera
    return Cameras(
        given=torch.from_numpy(estimates.intrinsics.matrix) if keep else None,
        metric_depth=None if metric is None else torch.from_numpy(metric.matrix),
        pointmap=None if pointmap is None else torch.from_numpy(pointmap.matrix),
    )


def _trust(camera: Intrinsics) -> int:
    """Return 1 for a known camera, 0 for an estimated one, -1 for a guessed one."""
    return int(camera.known) - int(camera.guessed)


def with_known_sizes(estimates: Estimates, state: State) -> State:
    """Return the state with the scene scaled by the user's known sizes or a measured depth."""
    measured, people = estimates.measured_scale, len(estimates.people)
    if not estimates.known and measured is None:
        return state
    from physic_core.engine.sizes.known_sizes import scale_scene_to_known_sizes

    statures = [math.nan] * people if estimates.statures is None else estimates.statures.tolist()
    by_depth = None if measured is None else measured.evidence
    assert state.scene is not None
    scene, known = scale_scene_to_known_sizes(
        estimates.known, statures, state.masks, state.scene, by_depth
    )
    sigma = state.scale_sigma if known.unscaled is None else known.scale_sigma
    return replace(state, scene=scene, known=known, scale_sigma=sigma)


def joint_problem(state: State) -> JointProblem:
    """Return the input of stage 3."""
    scene = state.scene
    assert scene is not None
    points, normals = scene.surface
    return JointProblem(
        model=state.model,
        rotations0=state.rotations,
        betas0=state.betas,
        expression0=state.expression,
        transl0=state.transl,
        keypoints=state.keypoints,
        keypoint_confidence=state.keypoint_confidence,
        skeleton=state.skeleton,
        K=scene.K,
        masks=state.masks,
        scene_points=points,
        scene_normals=normals,
        contact_probability=state.contact_prior,
        observed=state.observed,
        rotation_sigma=state.rotation_sigma,
        scene_depth=scene.depth,
        floor_normal=None if scene.floor is None else scene.floor.normal,
        floor_offset=0.0 if scene.floor is None else scene.floor.offset,
        floor_points=scene.floor_points,
        human_depth=state.photo_depth,
        human_points=state.human_points,
        scale_sigma=state.scale_sigma,
        foot_touch=state.foot_touch,
        estimated_transl=state.estimated_transl,
        keypoint_transl=state.keypoint_transl,
        known=state.known,
        views=state.views,
    ).to_model_dtype()


def contact_input(
    estimates: Estimates,
    state: State,
    problem: JointProblem,
    result: JointResult,
    method: ContactMethod,
) -> ContactInput:
    """Return the input of stage 4.

    Args:
        estimates: of the photo.
        state: of stage 2.
        problem: of stage 3.
        result: of stage 3.
        method: of stage 4.
    """
    s = result.scene_scale
    vertices = result.vertices
    finite = vertices[torch.isfinite(vertices).flatten(1).all(1)]
    floor = problem.floor_normal
    return ContactInput(
        model=problem.model,
        vertices=vertices,
        joints=result.joints,
        prior=problem.contact_probability,
        observed=problem.observed_anywhere,
        surfaces=method.surfaces(problem, finite, s),
        classes=_classify_points(estimates, state),
        plane=None if floor is None else (floor, problem.floor_offset * s),
        free=method.free_vertices(problem, vertices, s),
        objects=_held_objects(estimates, problem, result),
        stance=state.stance,
        in_mask=inside_mask(project(vertices, problem.K), problem.masks),
    )


def _classify_points(estimates: Estimates, state: State) -> ClassifiedPoints:
    """Return the classes of the valid scene points, all unknown if the segmenter labels none."""
    surfaces = estimates.people.surfaces
    assert state.scene is not None
    (inpainted,) = select_pixels(state.scene.valid, tensor(estimates.hole))
    if surfaces is None:
        nothing = torch.zeros_like(inpainted, dtype=torch.int64)
        return ClassifiedPoints(("unknown",), nothing, ~inpainted)
    (labels,) = select_pixels(state.scene.valid, tensor(surfaces.labels).long())
    return ClassifiedPoints(surfaces.names, labels, ~inpainted)


def _held_objects(
    estimates: Estimates, problem: JointProblem, result: JointResult
) -> HeldObjects | None:
    """Return the objects in the photo; None without any, or if their depth is unknown."""
    masks = estimates.objects
    if masks is None or not len(masks) or problem.human_depth is None:
        return None
    from physic_core.engine.contact.objects import HeldObjects

    depth = problem.human_depth * result.scene_scale
    ratios = [torch.nan if one is None else 1 / one for one in depth_ratios(problem, result)]
    shown = tensor(masks).to(depth.device)
    return HeldObjects(shown, depth, result.vertices.new_tensor(ratios), problem.K)
