"""Stage 2: place the people in the scene (paper Sec. 3.2).

The point map of the original photo is aligned to the scene on the background, which gives the 3D
points of each person. Each body is aligned with its keypoints (Eq. 2) and these points (Eq. 3-4).
In a scene of known size, people of unknown stature are resized first. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.engine.limbs import lowest_layer, observed_parts
from physic_core.engine.photo_content import PixelPoints
from physic_core.engine.placement.method import Fit, PlacementStageMethod
from physic_core.engine.placement.terms import PlacementProblem
from physic_core.engine.sizes.known_sizes import LocatedSizes, size_factors
from physic_core.engine.sizes.stature import resize_bodies, stature_factor
from physic_core.engine.state import Estimates, State
from physic_core.geometry.alignment import Alignment, apply_alignment, fit_alignment
from physic_core.geometry.pixels import all_finite, dilate_square, quantiles, span_of_true
from physic_core.geometry.pointmap import depth_to_pointmap
from physic_core.geometry.tensors import tensor
from physic_core.types.observations import LEAST_PROBABILITY, POSTURES

_FAR_M = 50.0  # maximum background depth used by the alignment
_MARGIN_PX = 8
_DEPTH_SHARE = 0.15  # standard deviation of the weight of background, of the range of inverse depth
_QUANTILE_PIXELS = 20_000
_FAR_WEIGHT = 0.05  # weight of background far from the people's depth
_ANKLES = joint_pair("ankle")


def solve_placement(estimates: Estimates, state: State, method: PlacementStageMethod) -> State:
    """Return the state with people in the scene, and with the depth of the photo aligned to it."""
    feet_seen = state.observed[:, _ANKLES].any(1)
    if state.known is not None and state.known.unscaled is not None:
        state = _resized(estimates, state, state.known, feet_seen, method)
    if not method.stance:
        state = replace(state, limb_touch_probability=None, rest_probability=None)
    elif state.limb_touch_probability is not None:
        rides = tensor(estimates.photo.observations.posture)[:, POSTURES.index("ride")]
        # feet on pedals or in stirrups touch, but not the ground
        on_ground = (
            1
            - rides.nan_to_num().to(state.limb_touch_probability)
            * state.limb_touch_probability[:, 4]
        )
        touch = state.limb_touch_probability.clone()
        touch[:, :2] *= on_ground[:, None]
        feet_seen = feet_seen & (touch[:, :2] >= LEAST_PROBABILITY).any(1)
        if state.rest_probability is not None:
            # whatever is lowest carries people who lie, and feet that rest on a bench do not
            across = torch.isfinite(state.rest_probability)
            feet_seen = torch.where(across, state.rest_probability >= LEAST_PROBABILITY, feet_seen)
            touch[:, :2] *= torch.where(across, state.rest_probability, 1.0)[:, None]
        state = replace(state, limb_touch_probability=touch)
    return _place_people(estimates, state, feet_seen, method)


def _place_people(
    estimates: Estimates, state: State, feet_seen: Tensor, method: PlacementStageMethod
) -> State:
    """Align the photo to the scene, and place the bodies in it."""
    scene = state.scene
    photo = estimates.photo.photo_points
    alignment = align_photo_points_to_scene(
        photo, estimates.photo.hole, scene.points, scene.valid, method, far=_FAR_M
    )
    aligned = move_photo_points_to_scene(photo.points, alignment, scene.K)
    clouds = tuple(human_points(aligned, photo.valid, mask, method) for mask in state.masks)
    # Given bodies stay, but for those that grow with a scene of known size.
    is_sized = state.known is not None and state.known.unscaled is not None
    stays = torch.zeros_like(state.is_given) if is_sized else state.is_given
    fits = [
        Fit() if stay else method.fit(person)
        for person, stay in zip(
            people_to_place(state, clouds, feet_seen, method), stays.tolist(), strict=True
        )
    ]
    agrees = alignment.inlier_share > 0
    depth = torch.where(photo.valid & all_finite(aligned), aligned[..., 2], torch.nan)
    return replace(
        state,
        photo_alignment=alignment,
        photo_depth=depth.to(state.transl) if agrees else None,
        human_points=tuple(cloud.to(state.transl) for cloud in clouds) if agrees else None,
        transl=_moved(state.transl, [fit.x for fit in fits]),
        estimated_transl=state.transl,
        keypoint_transl=_moved(state.transl, [fit.by_keypoints for fit in fits]),
        placement_failures=tuple(fit.problem for fit in fits),
    )


def _moved(transl: Tensor, moves: Sequence[Tensor]) -> Tensor:
    """Return translations (N, 3) after the moves (4,) of N people."""
    return transl + torch.stack(list(moves))[:, :-1].to(transl) if moves else transl


def people_to_place(
    state: State, clouds: Sequence[Tensor], feet_seen: Tensor, method: PlacementStageMethod
) -> list[PlacementProblem]:
    """Return what places each person, with the floor for people whose feet are visible.

    Args:
        state: with its scene.
        clouds: of N people, (M_i, 3) metres, see :func:`human_points`.
        feet_seen: (N,) bool.
        method: of stage 2.
    """
    scene = state.scene
    model = state.model
    posed = model(state.rotations, state.betas, state.transl, state.expression)
    normals, weights, masks = (
        _on_cpu(each) for each in method.problem_inputs(state, posed.vertices)
    )
    landmarks = _on_cpu(model.landmarks(posed, state.skeleton))
    vertices = _on_cpu(posed.vertices)
    keypoints = _on_cpu(state.keypoints)
    people = []
    resting = _vertices_that_may_rest(state, vertices)
    for i, body in enumerate(vertices):
        on_floor = scene.floor is not None and bool(feet_seen[i])
        person = PlacementProblem(
            landmarks=landmarks[i],
            keypoints=keypoints[i],
            confidence=weights[i],
            size=torch.ones(2, dtype=torch.float64),
            vertices=body,
            normals=normals[i],
            outer=model.outer,
            points=_on_cpu(clouds[i]),
            mask=masks[i],
            soles=body[resting[i]] if on_floor else body[:0],
            floor=scene.floor if on_floor else None,
            K=_on_cpu(scene.K),
            row=i,
            people=len(vertices),
        )
        people.append(method.usable_problem(person))
    return people


def _vertices_that_may_rest(state: State, vertices: Tensor) -> list[Tensor]:
    """Return the vertices of each person that may rest on the floor: the lowest skin in sight of
    those who lie, plank or are on all fours, the soles of others.
    """
    found = [state.model.soles] * len(state)
    if state.rest_probability is None:
        return found
    parts = observed_parts(state.model.part_names, state.observed)
    skin = parts[:, state.model.part_of_vertex] & state.model.outer
    heights = vertices @ state.up.to(vertices)
    for i in torch.isfinite(state.rest_probability).nonzero()[:, 0].tolist():
        if skin[i].any():
            found[i] = lowest_layer(heights[i], skin[i]).nonzero()[:, 0]
    return found


def _on_cpu(x: Tensor) -> Tensor:
    """Return a tensor on the CPU; numbers in float64."""
    return x.detach().to("cpu", torch.float64 if x.is_floating_point() else x.dtype)


def align_photo_points_to_scene(
    photo: PixelPoints,
    people: Tensor,
    scene_points: Tensor,
    scene_valid: Tensor,
    method: PlacementStageMethod,
    far: float = math.inf,
) -> Alignment:
    """Align the original photo's point map to the scene's point map on background pixels (Eq. 1).

    Args:
        photo: points of the original photo.
        people: (H, W) bool, pixels of all people.
        scene_points: (H, W, 3) point map of the scene, any unit.
        scene_valid: (H, W) bool.
        method: of stage 2.
        far: largest depth of scene pixels used, in the unit of the scene.

    Returns:
        The alignment; ``inlier_share`` is 0 without common pixels.
    """
    points = photo.points
    grown = dilate_square(people, round(method.mask_growth * max(people.shape)))
    background = ~grown & (scene_points[..., 2] <= far)
    weight = None
    if method.weighs_background:
        inverse = torch.where(photo.valid & (points[..., 2] > 0), 1 / points[..., 2], 0.0)
        weight = _weigh_background(inverse, people, background)
    usable = photo.valid & scene_valid & background
    return fit_alignment(
        points, scene_points, usable, photo.unknown, options=method.alignment, weight=weight
    )


def _weigh_background(inverse: Tensor, people: Tensor, background: Tensor) -> Tensor | None:
    """Return the weight (H, W) of pixels by the difference of inverse depth (H, W) to people; None
    means uniform.

    Two point maps of one scene differ by more than an affine map. Without weights, sky and far
    walls would dominate the alignment, and the ground at the feet would be wrong.
    """
    own = inverse[people & (inverse > 0)]
    others = inverse[background & (inverse > 0)]
    if not len(own) or not len(others):
        return None
    low, high = quantiles(own, (0.1, 0.9), _QUANTILE_PIXELS)
    nearest, farthest = quantiles(torch.cat((own, others)), (0.01, 0.99), _QUANTILE_PIXELS)
    extent = farthest - nearest
    if not extent > 0:
        return None
    gap = torch.maximum(low - inverse, inverse - high).clamp(min=0) / (_DEPTH_SHARE * extent)
    return _FAR_WEIGHT + (1 - _FAR_WEIGHT) * torch.exp(-0.5 * gap.square())


def move_photo_points_to_scene(points: Tensor, alignment: Alignment, K: Tensor) -> Tensor:
    """Apply the alignment to the original photo's point map (H, W, 3).

    Args:
        points: (H, W, 3), any unit.
        alignment: to the scene.
        K: (3, 3) px, camera of the scene, on whose rays the points are moved.

    Returns:
        (H, W, 3) metres; NaN if the alignment has no inliers, since the distance of people is then
        unknown.
    """
    if alignment.inlier_share == 0:
        return torch.full_like(points, math.nan)
    return depth_to_pointmap(apply_alignment(points, alignment)[..., 2], K)


def human_points(
    points: Tensor, valid: Tensor, mask: Tensor, method: PlacementStageMethod
) -> Tensor:
    """Return the points of one person, without depth edges and outliers.

    Args:
        points: (H, W, 3) metres, of the original photo, aligned to the scene.
        valid: (H, W) bool.
        mask: (H, W) bool, the person's visible pixels.
        method: of stage 2.

    Returns:
        (M, 3) metres; M = 0 if the mask has no valid point.
    """
    if not mask.any():
        return points.new_zeros((0, 3))
    box = span_of_true(mask.any(1), _MARGIN_PX), span_of_true(mask.any(0), _MARGIN_PX)
    cloud = points[box]
    inside = mask[box]
    is_known = valid[box] & all_finite(cloud) & (cloud[..., 2] > 0)
    cloud = torch.where(is_known[..., None], cloud, 0.0)
    return method.clean_points(cloud, is_known, inside, mask.shape)


def _resized(
    estimates: Estimates,
    state: State,
    known: LocatedSizes,
    feet_seen: Tensor,
    method: PlacementStageMethod,
) -> State:
    """Return the state with the size ratio of people in a scene of known size, and with people of
    unknown stature resized by it.

    Their sizes are measured before the scene was scaled, when bodies and scene roughly agree.
    """
    model = state.model
    unscaled = known.unscaled
    assert unscaled is not None
    placed = _place_people(estimates, replace(state, scene=unscaled), feet_seen, method)
    posed = model(state.rotations, state.betas, state.transl, state.expression).vertices
    assert placed.keypoint_transl is not None
    vertices = posed + (placed.keypoint_transl - state.transl)[:, None]
    floor = placed.scene.floor
    clouds = placed.human_points or (vertices[0, :0],) * len(posed)
    ratio = known.factor * size_factors(vertices, model.soles, feet_seen.tolist(), floor, clouds)
    own_stature = model.stature(state.betas)
    unknown = ~torch.isfinite(known.stature.to(own_stature))
    wanted = torch.where(unknown, own_stature * stature_factor(ratio, own_stature), own_stature)
    parts = (state.rotations.flatten(1), state.betas, state.expression, state.transl)
    wanted = torch.where(torch.isfinite(torch.cat(parts, 1)).all(1), wanted, torch.nan)
    betas, transl, _ = resize_bodies(model, state.rotations, state.betas, state.transl, wanted)
    return replace(state, betas=betas, transl=transl, size_ratio=ratio)
