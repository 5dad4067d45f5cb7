"""Inputs of the four stages of the engine, from the estimates and the results of earlier stages."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch

from physic_core.body.bones import rotations_from_parameters
from physic_core.body.joints import NUM_JOINTS
from physic_core.body.landmarks import keypoints_on_body
from physic_core.engine.contact.problem import ContactInput
from physic_core.engine.contact.scene_parts import ClassifiedPoints
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.placement.place import ObservedPeople
from physic_core.engine.placement.solve import EstimatedBodies, PhotoPoints
from physic_core.engine.scene.method import Cameras
from physic_core.engine.scene.solve import SceneInput
from physic_core.geometry.camera import project
from physic_core.geometry.tensors import optional_tensors, select_pixels, tensors
from physic_core.geometry.visibility import inside_mask
from physic_core.pipeline.floor_and_scale import floor_evidence
from physic_core.pipeline.person_measures import depth_ratios
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.engine.contact.method import ContactMethod
    from physic_core.engine.contact.objects import HeldObjects
    from physic_core.engine.joint.problem import JointResult, OtherView
    from physic_core.engine.placement.solve import PlacedPeople
    from physic_core.engine.scene.solve import SceneState
    from physic_core.engine.sizes.known_sizes import KnownScene
    from physic_core.engine.stance import Stance
    from physic_core.pipeline.estimate import Estimates
    from physic_core.types import Intrinsics


@dataclass(frozen=True)
class EngineInput(ShortRepr):
    """Estimates of a photo with B people, as tensors for the stages of the engine.

    Attributes:
        scene: input of stage 1.
        photo: point map of the photo with its people.
        bodies: as estimated.
        detections: of the same people; each keypoint has a landmark on the body.
        contact_probability: (B, V) of the contact prior.
        surfaces: (H, W) int64, index into ``surface_names`` of each pixel; None if the segmenter
            labels none.
        surface_names: classes of surfaces.
        objects: (K, H, W) bool, visible pixels of held objects; None if the segmenter does not
            detect objects.
        stance: of the same people.
    """

    scene: SceneInput
    photo: PhotoPoints
    bodies: EstimatedBodies
    detections: ObservedPeople
    contact_probability: Tensor
    surfaces: Tensor | None
    surface_names: tuple[str, ...]
    objects: Tensor | None
    stance: Stance


def engine_input(estimates: Estimates, model: BodyModel) -> EngineInput:
    """Convert the estimates; bodies and keypoints get the type and the device of the model."""
    people = estimates.people
    original = estimates.original
    parameters = estimates.bodies.parameters
    labels = people.surfaces
    on_body = keypoints_on_body(estimates.keypoints)
    points, valid, depth, photo, photo_valid, hole, masks, contact_probability = tensors(
        *(estimates.scene.points, estimates.scene.valid, estimates.depth.depth),
        *(
            original.points,
            original.valid,
            estimates.hole,
            people.masks,
            estimates.contact.probability,
        ),
    )
    observed, rotation_sigma, surfaces, objects = optional_tensors(
        estimates.bodies.observed,
        estimates.bodies.rotation_sigma,
        None if labels is None else labels.labels,
        estimates.objects,
    )
    betas, expression, transl, keypoints, confidence = (
        array.to(model.device, model.dtype)
        for array in tensors(
            *(
                parameters.betas,
                parameters.expression,
                parameters.transl,
                on_body.points,
                on_body.confidence,
            )
        )
    )
    rotations = rotations_from_parameters(parameters, model.device, model.dtype)
    if observed is None:
        observed = torch.ones(len(masks), NUM_JOINTS, dtype=torch.bool)
    evidence = floor_evidence(people, estimates.hole, estimates.keypoints, estimates.intrinsics)
    floor = replace(evidence, found=estimates.floor)
    return EngineInput(
        scene=SceneInput(points, valid, estimates.scene.unknown, depth, _cameras(estimates), floor),
        photo=PhotoPoints(photo, photo_valid, original.unknown, people=hole),
        bodies=EstimatedBodies(model, rotations, betas, expression, transl, rotation_sigma),
        detections=ObservedPeople(
            on_body.joint_set, keypoints, confidence, observed.to(model.device), masks
        ),
        contact_probability=contact_probability,
        surfaces=None if surfaces is None else surfaces.long(),
        surface_names=("unknown",) if labels is None else labels.names,
        objects=objects,
        stance=estimates.stance,
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


def sized_scene(estimates: Estimates, masks: Tensor, scene: SceneState) -> KnownScene | None:
    """Return the scene scaled by the user's known sizes or a measured depth; None without either.

    Args:
        masks: (B, H, W) bool, visible pixels of each person.
        scene: of stage 1.
    """
    measured = estimates.measured_scale
    if not estimates.known and measured is None:
        return None
    from physic_core.engine.sizes.known_sizes import scale_scene_to_known_sizes

    people = len(estimates.people)
    statures = [math.nan] * people if estimates.statures is None else estimates.statures.tolist()
    by_depth = None if measured is None else measured.evidence
    return scale_scene_to_known_sizes(estimates.known, statures, masks, scene, by_depth)


def joint_problem(
    given: EngineInput,
    placed: PlacedPeople,
    known: KnownScene | None,
    scale_sigma: float | None,
    views: tuple[OtherView, ...] = (),
) -> JointProblem:
    """Return the input of stage 3.

    Args:
        given: of the engine.
        placed: result of stage 2.
        known: see :func:`sized_scene`.
        scale_sigma: standard deviation of log(scale) of the scene, or None.
        views: what other cameras show of the same people.
    """
    scene = placed.scene
    photo = placed.photo
    bodies = placed.bodies
    detections = given.detections
    agrees = photo.alignment.inlier_share > 0
    points, normals = scene.surface
    return JointProblem(
        model=bodies.model,
        rotations0=bodies.rotations,
        betas0=bodies.betas,
        expression0=bodies.expression,
        transl0=placed.placement.transl,
        keypoints=detections.keypoints,
        keypoint_confidence=detections.confidence,
        skeleton=detections.skeleton,
        K=scene.K,
        masks=detections.masks,
        scene_points=points,
        scene_normals=normals,
        contact_probability=given.contact_probability,
        observed=given.detections.observed,
        rotation_sigma=bodies.rotation_sigma,
        scene_depth=scene.depth,
        floor_normal=None if scene.floor is None else scene.floor.normal,
        floor_offset=0.0 if scene.floor is None else scene.floor.offset,
        floor_points=scene.floor_points,
        human_depth=photo.depth if agrees else None,
        human_points=photo.people if agrees else None,
        scale_sigma=scale_sigma,
        foot_touch=placed.foot_touch,
        estimated_transl=bodies.transl,
        keypoint_transl=placed.placement.keypoint_transl,
        known=None if known is None else known.geometry,
        views=views,
    ).to_model_dtype()


def contact_input(
    given: EngineInput,
    scene: SceneState,
    problem: JointProblem,
    result: JointResult,
    method: ContactMethod,
) -> ContactInput:
    """Return the input of stage 4.

    Args:
        scene: of stage 2.
        problem: of stage 3.
        result: of stage 3.
        method: of stage 4.
    """
    s = result.scene_scale
    vertices = result.vertices
    finite = vertices[torch.isfinite(vertices).flatten(1).all(1)]
    objects = given.objects
    return ContactInput(
        model=problem.model,
        vertices=vertices,
        joints=result.joints,
        prior=problem.contact_probability,
        observed=problem.observed_anywhere,
        surfaces=method.surfaces(problem, finite, s),
        classes=_classify_points(given, scene),
        plane=None
        if problem.floor_normal is None
        else (problem.floor_normal, problem.floor_offset * s),
        free=method.free_vertices(problem, vertices, s),
        objects=None if objects is None else _held_objects(problem, result, objects),
        stance=given.stance,
        in_mask=inside_mask(project(vertices, problem.K), problem.masks),
    )


def _classify_points(given: EngineInput, scene: SceneState) -> ClassifiedPoints:
    """Return the classes of the valid scene points, all unknown if the segmenter labels no
    surfaces.
    """
    (inpainted,) = select_pixels(scene.valid, given.photo.people)
    labels = torch.zeros_like(inpainted, dtype=torch.int64)
    if given.surfaces is not None:
        (labels,) = select_pixels(scene.valid, given.surfaces)
    return ClassifiedPoints(given.surface_names, labels, ~inpainted)


def _held_objects(problem: JointProblem, result: JointResult, masks: Tensor) -> HeldObjects | None:
    """Return the objects in the photo; None without any, or if their depth is unknown."""
    if not len(masks) or problem.human_depth is None:
        return None
    from physic_core.engine.contact.objects import HeldObjects

    depth = problem.human_depth * result.scene_scale
    ratios = [torch.nan if one is None else 1 / one for one in depth_ratios(problem, result)]
    return HeldObjects(masks.to(depth.device), depth, result.vertices.new_tensor(ratios), problem.K)
