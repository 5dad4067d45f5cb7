"""Run the engine on the backends' results: stages 1 to 3, then the contact map.

Stage 1 builds the metric scene (paper Sec. 3.1), stage 2 places the people (Sec. 3.2), stage 3 optimises scene and
people jointly (Sec. 3.3). OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch

from physic_core.body.joints import joint_pair
from physic_core.body.landmarks import keypoints_on_body
from physic_core.body.parameters import rotations_from_parameters
from physic_core.engine.contact.support import hands_may_hold
from physic_core.engine.joint.final_scene import finalize_scene
from physic_core.engine.joint.limbs import is_standing
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.solve import optimize
from physic_core.engine.known_sizes import known_geometry, scale_scene, scene_factor, stature_factor
from physic_core.engine.placement.human_points import AlignedPhoto, PhotoPoints, align_photo
from physic_core.engine.placement.lifted_feet import depth_gaps_at_feet, find_lifted_feet
from physic_core.engine.placement.people import Detections, observed_joints, place_people
from physic_core.engine.placement.place import Placement, PosedBodies
from physic_core.engine.scene.camera import Cameras
from physic_core.engine.scene.floor_below_people import without_floor, wrong_floor
from physic_core.engine.scene.solve import SceneInput, alignment_diagnostics, solve_scene
from physic_core.geometry.floor import FloorEvidence
from physic_core.geometry.tensors import tensor
from physic_core.pipeline.estimate import feet_pixels
from physic_core.pipeline.known_sizes import check_people_in_scene, contradictions, floor_contradiction, resize_bodies
from physic_core.pipeline.solution import Solution, assemble_solution, scene_alone

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.engine.known_sizes import KnownGeometry
    from physic_core.engine.placement.settings import PlacementSettings
    from physic_core.engine.scene.solve import SceneState
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import BodyParameters, Intrinsics, Skeleton

__all__ = ["run_engine"]

_EXACT_SCALE_SIGMA = 0.01  # of the log scale of a scene that the user's sizes have scaled
_RAISED_SURFACES = ("seat", "bed", "table", "cabinet", "vehicle")
_SHOULDERS, _WRISTS = joint_pair("shoulder"), joint_pair("wrist")


def run_engine(estimates: Estimates, settings: EngineSettings, model: BodyModel, stages: StageRunner) -> Solution:
    """Run scene, placement, joint optimisation and contact on the device of the body model.

    Without people, the scene is the result. The pipeline uses the CPU, since nearest-point search and ray casts run
    there.
    """
    # Eighty L-BFGS steps amplify rounding errors a million times: float32 results would differ between CPUs.
    model = model.to(dtype=torch.float64)
    with stages.time_engine("scene"):
        estimated = _metric_scene(estimates, settings)
        scene, known, factor = _scene_of_known_size(estimates, estimated)
    if estimates.scale_guess and factor is None:
        stages.warn(estimates.scale_guess)
    if not len(estimates.people):
        sigma = estimates.depth.scale_sigma if factor is None else _EXACT_SCALE_SIGMA
        return scene_alone(estimates, scene, model, sigma)
    with stages.time_engine("placement"):
        photo = _align_photo(estimates, scene, settings.placement)
        bodies = _pose_bodies(estimates, estimates.bodies.parameters, model, settings.placement)
        if factor is not None:
            ratio = factor * _size_by_scene(estimates, estimated, bodies, settings.placement)
            assert known is not None
            stages.warn(*check_people_in_scene(known, estimates.statures, model.stature(bodies.betas), ratio))
            bodies = _bodies_of_scene_size(estimates, bodies, ratio, model, settings.placement)
        detections = _detections(estimates, photo, bodies)
        feet = None
        labelled = estimates.people.surfaces is not None and scene.floor_normal is not None
        if settings.placement.detect_lifted_feet and labelled:
            gaps = _gaps_at_feet(estimates, scene, photo, detections)
            feet = find_lifted_feet(gaps, _hands_may_hold(estimates, bodies, scene), scene.floor_offset)
            detections = replace(detections, airborne=feet.airborne)
        placed = place_people(bodies.posed, detections, bodies.K(scene), scene.floor_plane, settings.placement)
        normals = scene.normals[scene.valid]
        if not_theirs := wrong_floor(scene.floor, bodies.placed_vertices(placed), bodies.joints, normals):
            if known is not None and known.camera_height is not None:
                raise floor_contradiction(known, estimated.floor_offset)
            scene = without_floor(scene, not_theirs)
            placed = place_people(bodies.posed, detections, bodies.K(scene), None, settings.placement, before=placed)
    with stages.time_engine("joint optimisation"):
        observed = observed_joints(detections, settings.placement)
        problem = _joint_problem(estimates, scene, photo, bodies, placed, observed)
        if known is not None:
            sigma = problem.scale_sigma if factor is None else _EXACT_SCALE_SIGMA
            problem = replace(problem, known=known, scale_sigma=sigma)
        if feet is not None:
            problem = replace(
                problem, grounded=placed.grounded & ~feet.airborne, lifted_feet=feet.lifted.to(model.device)
            )
        # Without a common background the depth of people is unknown; a warning reports it.
        blind = problem.human_depth is None
        result = optimize(problem, settings.joint.without("depth") if blind else settings.joint)
    with stages.time_engine("contact"):
        scene, problem = finalize_scene(scene, problem, result, tensor(estimates.hole), settings.scene)
        placement = {
            "alignment": alignment_diagnostics(photo.alignment),
            "people": placed.diagnostics,
        }
        warnings, measured = contradictions(estimates.known, scene, problem, result)
        stages.warn(*warnings)
        solution = assemble_solution(estimates, scene, problem, placement, result, settings)
        return replace(solution, diagnostics={**solution.diagnostics, **measured})


# ---- stage 1: the scene in metres (Sec. 3.1) -------------------------------------------------------------------------


def _metric_scene(estimates: Estimates, settings: EngineSettings) -> SceneState:
    height, width = estimates.hole.shape
    given = SceneInput(
        tensor(estimates.scene.points),
        tensor(estimates.scene.valid),
        estimates.scene.unknown,
        tensor(estimates.depth.depth),
        _cameras(estimates),
        FloorEvidence(
            mask=None if estimates.people.floor is None else tensor(estimates.people.floor),
            hole=tensor(estimates.hole),
            feet_px=tensor(feet_pixels(estimates.keypoints, height, width)),
        ),
    )
    return solve_scene(given, settings.scene)


def _cameras(estimates: Estimates) -> Cameras:
    """Return the cameras for stage 1: known ones before estimated ones before guessed ones."""
    metric, pointmap = estimates.depth.intrinsics, estimates.scene.intrinsics
    keep = estimates.camera_given or (pointmap is not None and (metric is None or _trust(pointmap) > _trust(metric)))
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


def _scene_of_known_size(
    estimates: Estimates, scene: SceneState
) -> tuple[SceneState, KnownGeometry | None, float | None]:
    """Return the scene scaled to the known sizes, those sizes and the factor; no factor if nothing gives one."""
    if not estimates.known:
        return scene, None, None
    people = len(estimates.people)
    statures = [math.nan] * people if estimates.statures is None else estimates.statures.tolist()
    known = known_geometry(estimates.known, statures, tensor(estimates.people.masks), scene)
    factor = scene_factor(known, scene.floor_offset if scene.floor_normal is not None else None)
    if factor is not None:
        scene, known = scale_scene(scene, known, factor)
    return scene, known, factor


# ---- stage 2: people in the scene (Sec. 3.2) -------------------------------------------------------------------------


def _align_photo(estimates: Estimates, scene: SceneState, settings: PlacementSettings) -> AlignedPhoto:
    original = estimates.original
    photo = PhotoPoints(
        tensor(original.points), tensor(original.valid), original.unknown, people=tensor(estimates.hole)
    )
    return align_photo(photo, scene, tensor(estimates.people.masks), settings)


@dataclass(frozen=True)
class _EstimatedBodies:
    """Posed bodies of the body estimator on the engine's device.

    Attributes:
        model: of all bodies.
        posed: their vertices and landmarks.
        rotations: (B, 55, 3, 3).
        betas: (B, K).
        expression: (B, E).
        keypoints: (B, J, 2) px, those with a landmark on the body.
        confidence: (B, J).
        skeleton: of these keypoints.
        joints: (B, 55, 3) metres.
    """

    model: BodyModel
    posed: PosedBodies
    rotations: Tensor
    betas: Tensor
    expression: Tensor
    keypoints: Tensor
    confidence: Tensor
    skeleton: Skeleton
    joints: Tensor

    def K(self, scene: SceneState) -> Tensor:
        return scene.K.to(self.betas)

    def placed_vertices(self, placed: Placement) -> Tensor:
        """Return the vertices (B, V, 3) of the placed bodies, metres."""
        return self.posed.vertices + (placed.transl - self.posed.transl)[:, None]


def _pose_bodies(
    estimates: Estimates, parameters: BodyParameters, model: BodyModel, settings: PlacementSettings
) -> _EstimatedBodies:
    device, dtype = model.device, model.dtype
    known = keypoints_on_body(estimates.keypoints)
    rotations = rotations_from_parameters(parameters, device, dtype)
    betas, expression, transl, keypoints, confidence = (
        tensor(x).to(device, dtype)
        for x in (parameters.betas, parameters.expression, parameters.transl, known.points, known.confidence)
    )
    body = model(rotations, betas, transl, expression)
    posed = PosedBodies(
        vertices=body.vertices,
        normals=settings.method().normals(body.vertices, model.faces),
        landmarks=model.landmarks(body, known.joint_set),
        transl=transl,
        outer=model.outer,
        soles=torch.cat([model.contact_sets["left_sole"], model.contact_sets["right_sole"]]),
    )
    return _EstimatedBodies(
        model, posed, rotations, betas, expression, keypoints, confidence, known.joint_set, body.joints
    )


def _size_by_scene(
    estimates: Estimates, scene: SceneState, bodies: _EstimatedBodies, settings: PlacementSettings
) -> Tensor:
    """Return the factor (B,) by which people must be enlarged to stand in the scene as the photo shows them.

    The photo shows the direction of each body, so that its size follows from its depth: that of the floor under visible
    soles, else that of the person's points. Points of people are too far away by a common share, which the people on
    the floor show. NaN where nothing is known.

    Args:
        scene: before the known sizes, where bodies and scene roughly agree: who stands on furniture shows there.
    """
    photo = _align_photo(estimates, scene, settings)
    placed = place_people(
        bodies.posed, _detections(estimates, photo, bodies), bodies.K(scene), scene.floor_plane, settings
    )
    at = placed.keypoint_transl.to(bodies.posed.transl) - bodies.posed.transl
    vertices = bodies.posed.vertices + at[:, None]
    by_floor, by_points = (torch.full_like(vertices[:, 0, 0], torch.nan) for _ in range(2))
    for i, (body, person) in enumerate(zip(vertices, placed.people, strict=True)):
        if scene.floor_plane is not None and bodies.posed.soles is not None and person.on_floor and person.grounded:
            normal, offset = scene.floor_plane
            drop = -(body[bodies.posed.soles] @ normal.to(body)).amin()
            by_floor[i] = offset / drop if bool(drop > 0) else torch.nan
        if len(photo.people[i]):
            by_points[i] = photo.people[i][:, 2].median().to(body) / body[:, 2].median()
    too_far = (by_points / by_floor).nanmedian().nan_to_num(nan=1.0)
    return torch.where(torch.isfinite(by_floor), by_floor, by_points / too_far)


def _bodies_of_scene_size(
    estimates: Estimates, bodies: _EstimatedBodies, ratio: Tensor, model: BodyModel, settings: PlacementSettings
) -> _EstimatedBodies:
    """Resize people of unknown stature by the factors of :func:`_size_by_scene`, and pose them again."""
    own = model.stature(bodies.betas)
    wanted = own * stature_factor(ratio, own)
    if estimates.statures is not None:
        wanted = torch.where(torch.isfinite(tensor(estimates.statures).to(own)), own, wanted)
    wanted = torch.where(torch.isfinite(bodies.posed.vertices).flatten(1).all(1), wanted, torch.nan)
    betas, transl, _ = resize_bodies(model, bodies.rotations, bodies.betas, bodies.posed.transl, wanted)
    resized = replace(estimates.bodies.parameters, betas=betas.cpu().numpy(), transl=transl.cpu().numpy())
    return _pose_bodies(estimates, resized, model, settings)


def _gaps_at_feet(estimates: Estimates, scene: SceneState, photo: AlignedPhoto, detections: Detections) -> Tensor:
    """Return the gaps of depth at the feet (B, 2) of a photo with labels of its surfaces."""
    surfaces = estimates.people.surfaces
    assert surfaces is not None
    raised = tensor(surfaces.mask(*_RAISED_SURFACES))
    return depth_gaps_at_feet(detections, photo.depth, torch.where(scene.valid, scene.depth, torch.nan), raised)


def _hands_may_hold(estimates: Estimates, bodies: _EstimatedBodies, scene: SceneState) -> Tensor:
    """Return which people (B,) bool may hold something, and do not stand upright with their hands down."""
    assert scene.floor_normal is not None
    contact = tensor(estimates.contact.probability).to(bodies.betas)
    joints, rotations, up = bodies.joints, bodies.rotations, scene.floor_normal.to(bodies.betas)
    everything = torch.ones(joints.shape[:2], dtype=torch.bool, device=joints.device)
    height = joints @ up
    hands_up = (height[:, _WRISTS] > height[:, _SHOULDERS]).all(1)
    may_hold = hands_may_hold(bodies.model, contact).any(1)
    return (may_hold & (hands_up | ~is_standing(rotations, joints, everything, up))).cpu()


def _detections(estimates: Estimates, photo: AlignedPhoto, bodies: _EstimatedBodies) -> Detections:
    observed = estimates.bodies.observed
    return Detections(
        skeleton=bodies.skeleton,
        keypoints=bodies.keypoints,
        confidence=bodies.confidence,
        observed=None if observed is None else tensor(observed),
        points=photo.people,
        masks=tensor(estimates.people.masks),
    )


# ---- stage 3: joint optimisation (Sec. 3.3) -------------------------------------------------------------------------


def _joint_problem(
    estimates: Estimates,
    scene: SceneState,
    photo: AlignedPhoto,
    bodies: _EstimatedBodies,
    placed: Placement,
    observed: Tensor,
) -> JointProblem:
    like = bodies.betas
    agrees = photo.alignment.inlier_share > 0
    return JointProblem(
        model=bodies.model,
        rotations0=bodies.rotations,
        betas0=bodies.betas,
        expression0=bodies.expression,
        transl0=placed.transl.to(like),
        keypoints=bodies.keypoints,
        keypoint_confidence=bodies.confidence,
        skeleton=bodies.skeleton,
        K=scene.K.to(like),
        masks=tensor(estimates.people.masks).to(like.device),
        scene_points=scene.points[scene.valid].to(like),
        scene_normals=scene.normals[scene.valid].to(like),
        contact_probability=tensor(estimates.contact.probability).to(like),
        observed=observed,
        scene_depth=scene.depth.to(like),
        floor_normal=None if scene.floor_normal is None else scene.floor_normal.to(like),
        floor_offset=scene.floor_offset,
        floor_points=scene.floor_points.to(like),
        human_depth=photo.depth.to(like) if agrees else None,
        human_points=tuple(p.to(like) for p in photo.people) if agrees else None,
        scale_sigma=estimates.depth.scale_sigma,
        grounded=placed.grounded.to(like.device),
        estimated_transl=bodies.posed.transl,
        keypoint_transl=placed.keypoint_transl.to(like),
    )
