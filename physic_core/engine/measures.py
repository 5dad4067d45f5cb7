"""Measures of each person for the self-checks, from the final bodies, their contact and the photo.

OpenCV camera frame, metres. Silhouettes are drawn at a reduced size, so that a body takes a
fraction of a second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.nn.functional as F

from physic_core.engine.photo_content import FEWEST_PIXELS
from physic_core.engine.sizes.known_sizes import size_beside_others
from physic_core.engine.sizes.stature import size_sigmas, stature_sigmas
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.pixels import dilate_square
from physic_core.geometry.raster import rasterize
from physic_core.geometry.tensors import exact_arrays
from physic_core.types import Measures

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.engine.state import Estimates, State
    from physic_core.types import BoolArray, FloatArray, KnownSizes

_LONG_SIDE_PX = 400
_RIM = 0.03  # roots of the mask's area by which a body may leave the mask
_IN_FRONT_M = 0.05  # a scene point nearer than the body by more hides it
_LOW_SHARE = 0.15  # of the silhouette's height: feet of a standing person, seat or knees of another


def measure_agreement(estimates: Estimates, state: State) -> list[Measures]:
    """Measure how each person agrees with scene, floor, photo and the keypoints that the user gave.

    Args:
        estimates: of the photo.
        state: with the contact of the people and the final scene.
    """
    model = state.model
    scale = state.unapplied_scene_scale
    contact = state.contact
    floor = state.scene.floor
    assert contact is not None
    scene = state.scene.depth.to(state.transl) * scale
    photo = torch.full_like(scene, torch.nan)
    if state.photo_depth is not None:
        photo = state.photo_depth * scale
    silhouettes = compare_silhouettes(
        state.vertices, model.faces, state.masks, state.K, scene, photo
    )
    assert state.placement_failures is not None
    assert state.joint is not None
    measured = [
        Measures(problem or None, failure or None)
        for problem, failure in zip(state.placement_failures, state.joint.failures, strict=True)
    ]
    for i, support in enumerate(contact.supports):
        if support is None:
            continue
        body = state.vertices[i]
        heights = None
        gap = float(contact.distance[i].min())
        if floor is not None:
            heights = floor.scaled(scale).height(body)
            gap = min(gap, float(heights.min()))
        share, ratio = silhouettes[i]
        measured[i] = replace(
            measured[i],
            assumed_support=bool(support.hidden),
            body_in_mask_share=share,
            low_depth_ratio=ratio,
            clearance_m=max(0.0, gap) if gap != math.inf else None,
            sole_height_m=None if heights is None else float(heights[model.soles].min()),
        )
    is_given = estimates.is_given_keypoint
    return measured if is_given is None else _with_keypoints(measured, is_given, estimates, state)


def _with_keypoints(
    measured: list[Measures], given: BoolArray, estimates: Estimates, state: State
) -> list[Measures]:
    """Measure how far the given keypoints (N, J) bool lie from those of the bodies."""
    given = given[:, estimates.photo.keypoints.joint_set.fitted]
    names = state.skeleton.names
    regressor = state.model.regressor(state.skeleton)
    points = regressor(state.joints, state.vertices[:, regressor.vertex_ids])
    error_px = torch.linalg.vector_norm(project(points, state.K) - state.keypoints, dim=-1)
    stature = state.K[1, 1] * state.model.stature(state.betas) / state.joints[:, 0, 2]
    return [
        replace(
            measures,
            given_keypoints_px={names[j]: float(error_px[i, j]) for j in np.flatnonzero(is_given)},
            stature_px=float(stature[i]),
        )
        if is_given.any()
        else measures
        for i, (measures, is_given) in enumerate(zip(measured, given, strict=True))
    ]


def body_size_sigmas(estimates: Estimates, state: State) -> list[float]:
    """Return the standard deviation of the logarithm of each body's size."""
    sigma = state.scale_sigma if state.views or state.size_ratio is not None else None
    measured = estimates.ground.measured is not None
    if sigma is not None and measured and not estimates.photo.camera.known:
        # lengths across a measured depth
        sigma = math.hypot(sigma, estimates.photo.camera.focal_sigma or 0.0)
    stature, years = estimates.photo.known.filled(len(state))
    child = estimates.photo.observations.child
    sigmas: list[float] = size_sigmas(stature, years, child, sigma).tolist()
    return sigmas


def measure_known_sizes(known: KnownSizes, state: State) -> list[tuple[str, float, float]]:
    """Measure what the user knows on people and scene.

    Returns:
        For each size that could be measured its name, the given and the resulting metres.
    """
    if state.known is None:
        return []
    own_statures = state.model.stature(state.betas).tolist()
    statures = state.known.stature.tolist()
    sizes = [
        (f"the stature of person {i}", known_m, m)
        for i, (known_m, m) in enumerate(zip(statures, own_statures, strict=True))
        if math.isfinite(known_m)
    ]
    floor = state.scene.floor
    if known.camera_height is not None and floor is not None:
        height = floor.offset * state.unapplied_scene_scale
        sizes.append(("the camera height", known.camera_height, height))
    distances = state.known.distances
    normals = vertex_normals(state.vertices, state.model.faces)
    ends = distances.ends_on_bodies(state.vertices, normals, state.K)
    extents = distances.measure(ends, state.vertices, state.unapplied_scene_scale)
    for index, extent in zip(distances.index.tolist(), map(float, extents), strict=True):
        length = known.lengths[index]
        name = f"the length from {pixel_text(length.start)} to {pixel_text(length.end)}"
        sizes.append((name, length.metres, extent))
    return sizes


def pixel_text(at: Sequence[float]) -> str:
    """Format a pixel x, y."""
    return f"({at[0]:.0f}, {at[1]:.0f})"


def compare_statures(
    measured: Sequence[Measures],
    estimates: Estimates,
    placed: State,
    state: State,
    off_floor: FloatArray,
) -> list[Measures]:
    """Compare each person's stature of the given age or size with what the photo shows.

    The joint fit leaves some people above the floor: the photo shows these as large as bodies that
    stand on it.

    Args:
        measured: of N people.
        estimates: with their ages and statures.
        placed: state before stage 3, whose bodies have the given statures, or the usual ones of the
            given ages.
        state: after stage 3.
        off_floor: (N,) log factor by which each body must grow to stand on the floor.

    Returns:
        The measures, with the statures of people of known age or stature.
    """
    before, after = exact_arrays(
        *(one.model.stature(one.betas).double().log() for one in (placed, state))
    )
    after = after + off_floor
    stature, years = estimates.photo.known.filled(len(before))
    is_sized = state.known is not None and state.known.unscaled is not None
    sigma = stature_sigmas(stature, years)
    compared = list(measured)
    for i in np.flatnonzero(
        (np.isfinite(years) | np.isfinite(stature)) & np.isfinite(after)
    ).tolist():
        # A scene that the user's sizes have scaled does not grow with its people.
        person_row = slice(i, i + 1)
        shown_stature, spread = (
            size_beside_others(before[person_row], after[person_row], sigma[person_row], 0)
            if is_sized
            else size_beside_others(before, after, sigma, i)
        )
        compared[i] = replace(
            compared[i],
            given_stature_m=math.exp(before[i]),
            shown_stature_m=math.exp(shown_stature),
            stature_sigmas=abs(shown_stature - before[i]) / spread,
        )
    return compared


def compare_silhouettes(
    vertices: Tensor,
    faces: Tensor,
    masks: Tensor,
    K: Tensor,
    scene_depth: Tensor,
    photo_depth: Tensor,
) -> list[tuple[float | None, float | None]]:
    """Measure how the silhouettes of N bodies agree with their masks, and the depth of their lower
    ends.

    Args:
        vertices: (N, V, 3) metres.
        faces: (F, 3) int64.
        masks: (N, H, W) bool, visible pixels of the same N people.
        K: (3, 3) px.
        scene_depth: (H, W) metres along z of the scene without people, NaN where unknown.
        photo_depth: (H, W) metres along z of the photo with its people, NaN where unknown.

    Returns:
        Per person ``body_in_mask_share`` and ``low_depth_ratio`` of :class:`Measures`.
    """
    height, width = masks.shape[-2:]
    scale = min(1.0, _LONG_SIDE_PX / max(height, width))
    size = (max(1, round(height * scale)), max(1, round(width * scale)))
    masks = F.interpolate(masks[:, None].float(), size, mode="area")[:, 0] > 0
    K = K.to("cpu", torch.float32).clone()
    for row, factor in enumerate((size[1] / width, size[0] / height)):
        K[row] *= factor
        K[row, 2] += (factor - 1) / 2
    scene, photo = (
        F.interpolate(depth[None, None].float(), size, mode="nearest")[0, 0]
        for depth in (scene_depth, photo_depth)
    )
    shares = []
    for body, mask in zip(vertices.to("cpu", torch.float32), masks, strict=True):
        depth = _depth_of_body(body, faces, K, size)
        rim = max(1, round(_RIM * math.sqrt(float(mask.sum()))))
        visible = torch.isfinite(depth) & (mask | ~masks.any(0)) & ~(scene < depth - _IN_FRONT_M)
        inside = _area_share(visible & dilate_square(mask, rim), visible & mask.any())
        shares.append((inside, _low_depth_ratio(depth, mask, photo)))
    return shares


def _depth_of_body(body: Tensor, faces: Tensor, K: Tensor, size: tuple[int, int]) -> Tensor:
    """Return the depth of a body (V, 3) at each pixel, (H, W) metres; inf beside it."""
    face = rasterize(project(body, K)[None], body[None, :, 2], faces, *size)[0]
    z = body[faces][..., 2].mean(1)
    return torch.where(face >= 0, z[face.clamp(min=0)], torch.inf)


def _low_depth_ratio(depth: Tensor, mask: Tensor, photo_depth: Tensor) -> float | None:
    body = torch.isfinite(depth)
    rows = body.any(1).nonzero()[:, 0]
    if not len(rows):
        return None
    low = torch.zeros_like(body)
    low[int(rows[-1] - _LOW_SHARE * (rows[-1] - rows[0])) :] = True
    ratio = (photo_depth / depth)[body & mask & low]
    ratio = ratio[torch.isfinite(ratio) & (ratio > 0)]
    return float(ratio.median()) if len(ratio) >= FEWEST_PIXELS else None


def _area_share(part: Tensor, surface: Tensor) -> float | None:
    total = float(surface.sum())
    return float(part.sum()) / total if total > 0 else None
