"""Stage 1: build the metric scene with camera, normals and floor (paper Sec. 3.1).

The relative point map gives the shape, and the metric depth the scale (Eq. 1). OpenCV camera frame
(x right, y down, z forward).
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from physic_core.body.bones import pose_from_parameters
from physic_core.body.joints import NUM_JOINTS
from physic_core.body.landmarks import keypoints_on_body
from physic_core.body.model import BodyModel
from physic_core.engine.ground.floor import FloorEvidence
from physic_core.engine.photo_content import PixelPoints
from physic_core.engine.scene.method import Cameras, SceneStageMethod, scene_camera
from physic_core.engine.scene_state import SceneState
from physic_core.engine.sizes.known_sizes import scale_scene_to_known_sizes
from physic_core.engine.state import Estimates, State
from physic_core.engine.up import surest_up
from physic_core.errors import BackendOutputError
from physic_core.geometry.alignment import Alignment, apply_alignment, fit_alignment
from physic_core.geometry.camera import unproject
from physic_core.geometry.floor import FloorSearch, PlaneFit
from physic_core.geometry.pixels import all_finite, select_pixels
from physic_core.geometry.pointmap import depth_to_pointmap
from physic_core.geometry.tensors import tensor, to_dtype

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics

_FLOOR_THICKNESS = 0.01  # of the depth


def solve_scene(estimates: Estimates, model: BodyModel, method: SceneStageMethod) -> State:
    """Return the state of a photo: its scene, scaled by the user's known sizes or a measured depth,
    and the people as estimated.

    Args:
        estimates: of the photo.
        model: body model of the people, whose type their tensors get.
        method: of stage 1.

    Raises:
        BackendOutputError: the metric depth has no valid pixel, or the camera cannot be estimated.
    """
    ground = estimates.ground
    evidence = replace(ground.evidence, known_search=ground.search)
    depth = tensor(estimates.depth.depth)
    scene = build_scene(
        estimates.photo.scene_points, depth, _cameras_by_trust(estimates), evidence, method
    )
    return _with_known_sizes(estimates, _initial_state(estimates, model, scene))


def _cameras_by_trust(estimates: Estimates) -> Cameras:
    """Return the cameras for stage 1: known ones before estimated ones before guessed ones."""
    metric = estimates.depth.intrinsics
    pointmap = estimates.photo.scene_map.intrinsics
    keep = estimates.camera_by_user_or_file or (
        pointmap is not None and (metric is None or _trust_level(pointmap) > _trust_level(metric))
    )
    if (
        pointmap is not None
        and metric is not None
        and _trust_level(pointmap) < _trust_level(metric)
    ):
        pointmap = None
    if keep and metric is not None and metric.known:
        metric = None  # its depth does not depend on the camera
    cameras = estimates.photo.camera if keep else None, metric, pointmap
    return Cameras(*(None if one is None else torch.from_numpy(one.matrix) for one in cameras))


def _trust_level(camera: Intrinsics) -> int:
    """Return 1 for a known camera, 0 for an estimated one, -1 for a guessed one."""
    return int(camera.known) - int(camera.guessed)


def _initial_state(estimates: Estimates, model: BodyModel, scene: SceneState) -> State:
    """Return the people as estimated, in the type of the model."""
    bodies = estimates.bodies
    detected = keypoints_on_body(estimates.photo.keypoints)
    masks = estimates.photo.masks
    observed = bodies.observed

    def own(array: FloatArray) -> Tensor:
        return tensor(array).to(model.dtype)

    def own_if_stated(array: FloatArray | None) -> Tensor | None:
        return None if array is None else own(array)

    if observed is None:
        observed = np.ones((len(masks), NUM_JOINTS), bool)
    stance = estimates.ground.stance
    rotations, betas, transl, expression = pose_from_parameters(bodies.parameters, model.dtype)
    observations = estimates.photo.observations
    return State(
        model=model,
        skeleton=detected.joint_set,
        keypoints=own(detected.points),
        keypoint_confidence=own(detected.confidence),
        masks=masks,
        observed=tensor(observed),
        contact_prior=own(estimates.contact.probability),
        rotations=rotations,
        betas=betas,
        expression=expression,
        transl=transl,
        rotation_sigma=own_if_stated(bodies.rotation_sigma),
        joint_sigma=own_if_stated(bodies.joint_sigma),
        lean_sigma=own_if_stated(bodies.lean_sigma),
        distance_sigma=own_if_stated(bodies.distance_sigma),
        head=own(observations.head),
        head_sigma=own(observations.head_sigma) * (torch.pi / 180),
        scene=scene,
        K=scene.K.to(model.dtype),
        stand_probability=own(stance.stand_probability),
        rest_probability=own(stance.rest_probability),
        observed_touch=own(stance.touch),
        observed_floor=own(stance.on_floor),
        limb_touch_probability=own(stance.limb_touch_probability),
        carried=stance.carried,
        scale_sigma=estimates.depth.scale_sigma,
        views=to_dtype(estimates.views, model.dtype),
    )


def _with_known_sizes(estimates: Estimates, state: State) -> State:
    """Return the state with the scene scaled by the user's known sizes or a measured depth."""
    measured = estimates.ground.measured
    if not estimates.known and measured is None:
        return state
    stature, _ = estimates.photo.known.filled(len(state))
    by_depth = None if measured is None else measured.evidence
    scene, known = scale_scene_to_known_sizes(
        estimates.known, stature.tolist(), state.masks, state.scene, by_depth
    )
    sigma = state.scale_sigma if known.unscaled is None else known.scale_sigma
    return replace(state, scene=scene, known=known, scale_sigma=sigma)


def build_scene(
    relative: PixelPoints,
    depth: Tensor,
    cameras: Cameras,
    evidence: FloorEvidence,
    method: SceneStageMethod,
) -> SceneState:
    """Build the scene: scale the point map to metres, estimate camera, normals and floor, remove
    edges and outliers.

    Args:
        relative: points of the photo without its people.
        depth: (H, W) metres along z, NaN where unknown.
        cameras: known ones.
        evidence: of the floor.
        method: of stage 1.

    Raises:
        BackendOutputError: the metric depth has no valid pixel, or the camera cannot be estimated.
    """
    shared, depth, cameras = method.share_camera(relative.points, depth, cameras)
    relative = replace(relative, points=shared)
    alignment = _align_to_metric(relative, depth, cameras, method)
    placed, is_known, camera = _metric_points(relative, depth, cameras, alignment, method)
    normals, edges, outliers = method.pixel_surface(placed, is_known)
    search = method.search_floor(placed, is_known & ~outliers, normals, evidence)
    floor = search.plane
    floor_points = placed.new_zeros((0, 3))
    on_floor = _points_on(floor, placed, is_known)
    # A floor at a grazing angle resembles a depth edge: keep points on its plane.
    edges_off_floor = edges & ~on_floor
    outliers_off_floor = outliers & ~on_floor
    clean = is_known & ~(edges_off_floor | outliers_off_floor)
    if floor is not None:
        bare = on_floor & (normals == 0).all(-1)
        normals = torch.where(bare[..., None], floor.normal.to(normals), normals)
        feet = _intersect_feet(floor, evidence.feet_px, camera, method.far_m)
        (known_points,) = select_pixels(is_known, placed)
        (clean_points,) = select_pixels(clean, placed)
        floor_points = method.sample_floor(floor, known_points, clean_points, feet)
    return SceneState(
        points=placed,
        normals=normals,
        valid=clean,
        floor_points=floor_points,
        K=camera,
        floor=floor,
        up=surest_up(floor, evidence.up, evidence.slope_sigma_deg),
        diagnostics={
            "alignment": alignment_diagnostics(alignment),
            "valid_share": _share_of_true(clean),
            "edge_share": _share_of_true(edges_off_floor),
            "outlier_share": _share_of_true(outliers_off_floor),
            "floor": _floor_diagnostics(search),
            "fx_px": float(camera[0, 0]),
            "fy_px": float(camera[1, 1]),
        },
    )


def _points_on(floor: PlaneFit | None, placed: Tensor, known: Tensor) -> Tensor:
    """Return which points (H, W) lie on the floor."""
    if floor is None:
        return torch.zeros_like(known)
    thin = floor.height(placed).abs() < _FLOOR_THICKNESS * placed[..., 2]
    return known & floor.inliers & thin


def _align_to_metric(
    relative: PixelPoints, metric_depth: Tensor, cameras: Cameras, method: SceneStageMethod
) -> Alignment:
    """Align the point map to the metric depth (Eq. 1); without any camera, align z only."""
    metric_valid = _positive(metric_depth)
    if not metric_valid.any():
        raise BackendOutputError(
            "the metric depth has no valid pixel: every depth is NaN, infinite or not positive; "
            "use another metric_depth backend, or check its notes"
        )
    camera = cameras.metric_depth if cameras.metric_depth is not None else cameras.stated
    depth = torch.where(metric_valid, metric_depth, 1.0)
    if camera is not None:
        target = depth_to_pointmap(depth, camera.to(depth))
    else:
        target = torch.stack((torch.zeros_like(depth), torch.zeros_like(depth), depth), -1)
    options = replace(method.alignment, axes="z") if camera is None else method.alignment
    common = relative.valid & metric_valid
    return fit_alignment(relative.points, target, common, relative.unknown, options=options)


def _metric_points(
    relative: PixelPoints,
    metric_depth: Tensor,
    cameras: Cameras,
    alignment: Alignment,
    method: SceneStageMethod,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return metric points (H, W, 3), their validity (H, W) and their camera (3, 3).

    They come from the metric depth alone if the method selects it, or if the alignment has no
    inliers.
    """
    if method.uses_pointmap and alignment.inlier_share > 0:
        placed = apply_alignment(relative.points, alignment)
        known = relative.valid
    else:
        camera = scene_camera(relative.points, relative.valid, cameras)
        placed = depth_to_pointmap(metric_depth, camera)
        known = _positive(metric_depth)
    known = known & all_finite(placed) & (placed[..., 2] > 0)
    placed, camera = method.place_on_rays(placed, known, cameras)
    placed = torch.where(known[..., None], placed, 0.0)
    return placed, known & (placed[..., 2] <= method.far_m), camera


def alignment_diagnostics(alignment: Alignment) -> dict[str, Any]:
    """Return the diagnostics of an alignment as a dictionary; an infinite residual becomes None."""
    values = asdict(alignment)
    return values if math.isfinite(alignment.residual) else values | {"residual": None}


def _positive(depth: Tensor) -> Tensor:
    return torch.isfinite(depth) & (depth > 0)


def _share_of_true(mask: Tensor) -> float:
    return float(mask.double().mean())


def _intersect_feet(floor: PlaneFit, feet_px: Tensor, camera: Tensor, far_m: float) -> Tensor:
    """Intersect the rays of feet pixels with the floor: (F, 3), at most ``far_m`` away."""
    normal = floor.normal
    rays = unproject(feet_px.to(normal), normal.new_ones(len(feet_px)), camera)
    steepness = -(rays @ normal)
    falls = steepness > 1e-3
    centres = rays[falls] * (floor.offset / steepness[falls])[:, None]
    return centres[centres[:, 2] <= far_m]


def _floor_diagnostics(search: FloorSearch) -> dict[str, Any]:
    """Return the diagnostics of a floor search."""
    values: dict[str, Any] = {
        "reason": search.reason,
        "inlier_share": search.inlier_share,
        "below_share": search.below_share,
        "in_mask": search.in_mask,
    }
    if search.plane is not None:
        x, y, z = (float(c) for c in search.plane.normal)
        values |= {
            "source": search.plane.source,
            "camera_height_m": search.plane.offset,
            "pitch_deg": math.degrees(math.atan2(-z, -y)),
            "pitch_sigma_deg": math.degrees(search.plane.pitch_sigma),
            "roll_deg": math.degrees(math.atan2(x, -y)),
            "reanchored": search.plane.reanchored,
        }
    return values
