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
from physic_core.engine.scene.method import Cameras
from physic_core.engine.scene.solve import SceneInput
from physic_core.engine.state import State
from physic_core.geometry.tensors import tensor, tensors, to_device
from physic_core.pipeline.floor_and_scale import floor_evidence

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
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
        scene=scene,
        K=scene.K.to(model.device, model.dtype),
        stance=estimates.stance,
        scale_sigma=estimates.depth.scale_sigma,
        views=to_device(estimates.views, model.device, model.dtype),
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
    scene, known = scale_scene_to_known_sizes(
        estimates.known, statures, state.masks, state.scene, by_depth
    )
    sigma = state.scale_sigma if known.unscaled is None else known.scale_sigma
    return replace(state, scene=scene, known=known, scale_sigma=sigma)
