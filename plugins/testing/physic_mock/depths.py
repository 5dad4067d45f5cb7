"""Mocks of depth estimators: true depth with scale error or ambiguity, and with shape errors.

One network stands behind both: they share an offset of inverse depth and a focal length, and people
give the scale.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import DepthMap, Pointmap
from physic_mock.fill import fill_from_surroundings
from physic_mock.noise import NORMAL, RELIEF_LOST, SMEAR_PX, Noise, scale_to_image
from physic_mock.recognition import (
    MockOptions,
    RecognisedWorld,
    match_masks_to_world,
    recognise_world,
)
from physic_testing.worlds.world import pixel_rays

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Hints, Intrinsics, UInt8Array

_METRIC_SIGMA = math.hypot(NORMAL["metric scale"][1], NORMAL["focal length of both depths"][1])
_FAR = 0.95  # quantile of the depth of what counts as farthest
_MOST_OFFSET = 0.95  # of the inverse depth there


class MetricDepthOptions(MockOptions):
    """Options of :class:`MockMetricDepth`."""

    scale: float = Field(
        1.0, ge=1e-6, le=1e6, description="Factor on the true depth besides the drawn one."
    )
    stated_sigma: float = Field(
        _METRIC_SIGMA,
        ge=0,
        le=10,
        description="Returned standard deviation of log scale, whatever the noise; by default the "
        "true one at noise 1.",
    )


class MockMetricDepth(interfaces.MetricDepth):
    """Metric depth estimator that returns a world's depth with a scale error.

    The error of the distances of given bodies is an error of the scale, too. Without bodies a focal
    length error scales the depth by the same factor, as in networks that infer depth from sizes in
    px.
    """

    written_for = 1
    Options = MetricDepthOptions
    options: MetricDepthOptions

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return the depth map of a world's photo, with or without people, m; NaN in the sky.

        Raises:
            BackendError: the image shows no world.
        """
        options = self.options
        recognised = recognise_world(image, hints.hole)
        world = recognised.world
        noise = Noise(world, options)
        camera = hints.intrinsics or _noisy_camera(noise)
        depth = _noisy_depth(recognised, hints, noise)
        depth = _with_inverse_depth_offset(
            depth, _random_offset(depth, noise), world.empty_floor_mask
        )
        if hints.bodies is not None and hints.people is not None:
            sized = _distance_error(recognised, hints)
        else:
            sized = camera.fx / world.intrinsics.fx
        drawn = math.exp(noise.normal("metric scale"))
        depth = depth * options.scale * drawn * sized**noise.factor
        stated = "" if options.scale == 1 else f" times {options.scale:g}"
        return DepthMap(
            depth=np.where(np.isfinite(depth), depth, np.nan).astype(np.float32),
            intrinsics=camera,
            scale_sigma=options.stated_sigma,
            notes=(f"mock: true depth{stated}{options.note_on_errors}",),
        )


class RelativePointmapOptions(MockOptions):
    """Options of :class:`MockRelativePointmap`."""

    unknown: Literal["scale", "scale_shift", "inverse_scale_shift"] = Field(
        "inverse_scale_shift", description="Ambiguity of the returned point map."
    )
    scale: float = Field(
        1.0,
        ge=1e-6,
        le=1e6,
        description="Factor of the random unknown scale s: Z = s Z', Z = s Z' + t or 1 / Z = s "
        "/ Z' + t.",
    )
    shift: float | None = Field(
        None,
        ge=-1e6,
        le=1e6,
        description="The unknown shift t, meters or 1 / meters. By default, random for "
        "inverse_scale_shift, and 0 for scale_shift.",
    )
    up_sigma: float | None = Field(
        NORMAL["up"][1],
        gt=0,
        lt=90,
        description="Returned standard deviation of up, degrees, whatever the noise; None returns "
        "no up.",
    )


class MockRelativePointmap(interfaces.RelativePointmap):
    """Point map estimator that returns a world's points with unknown scale and shift, drawn per
    image.
    """

    written_for = 1
    Options = RelativePointmapOptions
    options: RelativePointmapOptions

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Return the point map of a world's photo, on the rays of ``hints.intrinsics`` if given.

        The sky is invalid.

        Raises:
            BackendError: the image shows no world.
        """
        options = self.options
        recognised = recognise_world(image, hints.hole)
        noise = Noise(recognised.world, options)
        depth = _noisy_depth(recognised, hints, noise)
        scale, shift = _scale_and_shift(recognised, depth, noise, options)
        camera = hints.intrinsics or _noisy_camera(noise)
        points = pixel_rays(camera) * depth[..., None]
        if options.unknown == "inverse_scale_shift":
            relative = points / depth[..., None] * (scale / (1 / depth - shift))[..., None]
        else:
            relative = (points - [0, 0, shift]) / scale
        valid = np.isfinite(relative).all(axis=2) & (relative[..., 2] > 0)
        return Pointmap(
            points=np.where(valid[..., None], relative, np.nan).astype(np.float32),
            valid=valid,
            unknown=options.unknown,
            intrinsics=camera,
            notes=(f"mock: true points in an unknown unit{options.note_on_errors}",),
            up=None if options.up_sigma is None else _noisy_up(noise),
            up_sigma=options.up_sigma,
            up_source="" if options.up_sigma is None else "mock",
        )


def _noisy_up(noise: Noise) -> FloatArray:
    """Return the normal of the floor, turned by a drawn angle about each of two axes across it."""
    normal = np.asarray(noise.world.floor.normal, np.float64)
    across = np.linalg.svd(normal[None])[2][1:]
    sigma = noise.factor * np.radians(NORMAL["up"][1])
    up = normal + sigma * noise.rng("up").normal(size=2) @ across
    return np.asarray(up / np.linalg.norm(up))


def _noisy_depth(recognised: RecognisedWorld, hints: Hints, noise: Noise) -> FloatArray:
    """Return the depth map (H, W) with all shape errors, m; NaN in the sky."""
    import cv2

    world = recognised.world
    depth = _visible_depth(recognised, hints, noise)
    relief_lost = min(1.0, noise.factor * RELIEF_LOST)
    for i, mask in enumerate(world.masks):
        farther = noise.normal("depth of person", str(i))
        depth = _flatten_relief(depth, mask & recognised.people_pixels, relief_lost, farther)
        # What somebody holds is as far away as they are, also to a network.
        is_held = np.zeros_like(mask)
        for k, item in enumerate(recognised.item_pixels):
            is_held |= item & recognised.present_people[i] & (world.touched_item[i] == k).any()
        depth = np.where(is_held, depth * np.exp(farther), depth)
    depth = _blur_depth_edges(depth, noise.factor * scale_to_image(SMEAR_PX, depth.shape))
    if noise.factor and hints.hole is not None and hints.hole.any():
        # From zero at the border of the hole.
        inside = cv2.distanceTransform(hints.hole.astype(np.uint8), cv2.DIST_L2, 5)
        ramp = np.minimum(inside / max(1.0, 0.02 * max(depth.shape)), 1.0)
        depth = depth * noise.smooth("hole", depth.shape, ramp=ramp)
    for name, of in (
        ("bumps", ""),
        ("point map", ""),
        ("point map of the", _image_kind(recognised)),
    ):
        depth = depth * noise.smooth(name, depth.shape, of)
    return np.where(np.isfinite(depth), depth, np.nan)


_EDGE_RATIO = 1.06  # farthest over nearest depth among 3 x 3 pixels
_REACH = 2.0  # a blurred edge fades out over this many of its widths


def _flatten_relief(
    depth: FloatArray, mask: BoolArray, relief_lost: float, offset: float
) -> FloatArray:
    """Reduce a person's relief about the median depth, and shift the person by a factor
    exp(offset).
    """
    is_known = mask & np.isfinite(depth)
    if not is_known.any() or relief_lost == offset == 0:
        return depth
    middle = float(np.median(depth[is_known]))
    result = depth.copy()
    result[is_known] = (middle + (1 - relief_lost) * (depth[is_known] - middle)) * np.exp(offset)
    return result


def _blur_depth_edges(depth: FloatArray, width_px: float) -> FloatArray:
    """Blur depth edges over ``width_px``, so that silhouette pixels lie between foreground and
    background.
    """
    import cv2

    if width_px == 0:
        return depth
    is_known = np.isfinite(depth)
    log_depth = np.where(is_known, np.log(np.where(is_known, depth, 1.0)), 0.0)
    kernel = np.ones((3, 3), np.uint8)
    low = np.where(is_known, log_depth, 99.0)
    high = np.where(is_known, log_depth, -99.0)
    edge = cv2.dilate(high, kernel) - cv2.erode(low, kernel) > np.log(_EDGE_RATIO)
    if not edge.any():
        return depth
    weight = cv2.GaussianBlur(is_known.astype(np.float64), (0, 0), width_px)
    blurred = cv2.GaussianBlur(log_depth, (0, 0), width_px) / np.maximum(weight, 1e-9)
    away = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 5).astype(np.float64)
    near = np.clip(1 - away / (_REACH * width_px), 0, 1)
    return np.where(is_known, np.exp((1 - near) * log_depth + near * blurred), depth)


def _scale_and_shift(
    recognised: RecognisedWorld, depth: FloatArray, noise: Noise, options: RelativePointmapOptions
) -> tuple[float, float]:
    """Draw the scale and shift of an image's point map; a drawn shift keeps all points in front."""
    unit = noise.normal("unit of both")
    if _image_kind(recognised) == "photo":
        unit += noise.normal("unit of the photo")
    scale = options.scale * math.exp(unit)
    if options.unknown == "scale":
        return scale, 0.0
    if options.shift is not None:
        return scale, options.shift
    return scale, _random_offset(depth, noise) if options.unknown == "inverse_scale_shift" else 0.0


def _image_kind(recognised: RecognisedWorld) -> str:
    """Return "photo" if a person is visible, else "empty"."""
    return "photo" if recognised.present_people.any() else "empty"


def _visible_depth(recognised: RecognisedWorld, hints: Hints, noise: Noise) -> FloatArray:
    """Return the depth map of what the image shows; people may have been removed from it.

    With noise, the depth of a hole is interpolated from around: hidden furniture is not known.
    """
    shown = recognised.people_pixels | recognised.item_pixels.any(axis=0)
    depth = np.where(shown, recognised.world.depth, recognised.world.empty_depth).astype(np.float64)
    if noise.factor == 0 or hints.hole is None:
        return depth
    # Inverse depth, which is linear on a plane, and zero in the sky.
    hole = hints.hole & ~shown
    inverse = fill_from_surroundings(1 / depth[..., None], hole)[..., 0]
    with np.errstate(divide="ignore"):
        return np.where(hole, 1 / inverse, depth)


def _random_offset(depth: FloatArray, noise: Noise) -> float:
    """Return the offset of inverse depth, 1 / metres: a share of the inverse depth of the farthest
    surfaces.

    Above 0, what is far comes out too far. The relative point map leaves the offset open; the
    metric depth has it as an error that is 0 in the middle of the floor.
    """
    share = min(noise.normal("offset of inverse depth"), _MOST_OFFSET)
    return share / float(np.quantile(depth[np.isfinite(depth)], _FAR))


def _with_inverse_depth_offset(depth: FloatArray, offset: float, floor: BoolArray) -> FloatArray:
    """Return the depth map after an offset of inverse depth, unchanged at the median depth of the
    floor.
    """
    if offset == 0:
        return depth
    is_known = np.isfinite(depth)
    middle = float(
        np.median(depth[is_known & floor] if (is_known & floor).any() else depth[is_known])
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        inverse = (1 / depth - offset) / (1 - offset * middle)
        return np.where(is_known & (inverse > 0), 1 / inverse, np.nan)


def _distance_error(recognised: RecognisedWorld, hints: Hints) -> float:
    """Return the geometric mean of the given bodies' distance over the true one; 1 without a body
    of this world.
    """
    assert hints.bodies is not None
    assert hints.people is not None
    world = recognised.world
    if hints.bodies.body_model != world.body_model or not len(hints.people):
        return 1.0
    rows = match_masks_to_world(
        replace(recognised, present_people=np.ones(len(world.masks), bool)), hints.people
    )
    true = world.joints[rows, 0, 2].astype(np.float64)
    depth = true + hints.bodies.parameters.transl[:, 2] - world.parameters.transl[rows, 2]
    return float(np.exp(np.mean(np.log(np.maximum(depth, 0.1 * true) / true))))


def _noisy_camera(noise: Noise) -> Intrinsics:
    """Return the camera with a focal length error."""
    factor = math.exp(noise.normal("focal length of both depths"))
    true = noise.world.intrinsics
    return replace(true, fx=true.fx * factor, fy=true.fy * factor, source="mock")
