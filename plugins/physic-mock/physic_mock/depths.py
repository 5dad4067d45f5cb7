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
from physic_mock.depth_noise import (
    add_hole_noise,
    add_smooth_noise,
    blur_depth_edges,
    flatten_relief,
)
from physic_mock.fill import fill_from_surroundings
from physic_mock.noise import scale_to_image, seeded_rng
from physic_mock.recognition import (
    MockOptions,
    RecognisedWorld,
    match_masks_to_world,
    recognise_world,
)

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Hints, Intrinsics, UInt8Array
    from physic_testing.worlds import World

# Sigmas are standard deviations of logarithms, unless stated otherwise.
_FOCAL_BIAS = math.log(1.2)  # of the focal length
_FOCAL_SIGMA = 0.07  # one draw a world
_METRIC_SIGMA = 0.09  # besides the error of the focal length or of the bodies' distances
_UNIT_SIGMA = 0.3  # of the point map's unit, in both images
_PHOTO_UNIT_SIGMA = 0.15  # in the photo with people alone
_PERSON_BIAS = 0.1  # of a person's depth; above 0 is too far
_PERSON_SIGMA = 0.08  # of that depth
_RELIEF_LOST = 0.3  # share of people's relief about their own median depth
_SMEAR_PX = 2.0  # width of the blur of depth edges, of a photo 640 px wide
_HOLE_SIGMA = 0.03  # where an inpainter made the picture up
_HOLE_WAVES = 6.0  # across the longer side
_BUMP_SIGMA = 0.007  # small bumps everywhere
_BUMP_WAVES = 16.0  # across the longer side
_WARP_SIGMA = 0.012  # of the whole map
_WARP_WAVES = 2.0  # across the longer side
_UP_SIGMA_DEG = 1.5  # of up, in each of two directions
_DISAGREEMENT_SIGMA = 0.014  # of each of the two images alone
_DISAGREEMENT_WAVES = 3.0  # across the longer side
_OFFSET_SHARE = 0.6  # mean, of the inverse depth of the farthest surfaces
_OFFSET_SIGMA = 0.4  # standard deviation, of the same
_FAR = 0.95  # quantile of the depth of what counts as farthest
_MOST_OFFSET = 0.95  # of the inverse depth there


class MetricDepthOptions(MockOptions):
    """Options of :class:`MockMetricDepth`."""

    scale: float = Field(
        1.0, ge=1e-6, le=1e6, description="Factor on the true depth besides the drawn one."
    )
    stated_sigma: float = Field(
        math.hypot(_METRIC_SIGMA, _FOCAL_SIGMA),
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
        noise = self.options.noise
        found = recognise_world(image, hints.hole)
        world = found.world
        camera = hints.intrinsics or _camera(world, options)
        drawn = math.exp(
            noise * _METRIC_SIGMA * seeded_rng(world, options.noise_seed, "metric scale").normal()
        )
        depth = _noisy_depth(found, hints, options)
        depth = _bent(depth, _drawn_offset(found, depth, options), world.empty_floor_mask)
        if hints.bodies is not None and hints.people is not None:
            sized = _distance_error(found, hints)
        else:
            sized = camera.fx / world.intrinsics.fx
        depth = depth * options.scale * drawn * sized**noise
        stated = "" if options.scale == 1 else f" times {options.scale:g}"
        return DepthMap(
            depth=np.where(np.isfinite(depth), depth, np.nan).astype(np.float32),
            intrinsics=camera,
            scale_sigma=options.stated_sigma,
            notes=(f"mock: true depth{stated}{options.noted}",),
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
        description="The unknown scale besides the drawn one: Z = s Z', Z = s Z' + t or 1 / Z = s "
        "/ Z' + t.",
    )
    shift: float | None = Field(
        None,
        ge=-1e6,
        le=1e6,
        description="The unknown shift t, metres or 1 / metres. None draws it for "
        "inverse_scale_shift, and is 0 for "
        "scale_shift. Unused where there is none.",
    )
    up_sigma: float | None = Field(
        _UP_SIGMA_DEG,
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
        found = recognise_world(image, hints.hole)
        depth = _noisy_depth(found, hints, options)
        scale, shift = _scale_and_shift(found, depth, options)
        camera = hints.intrinsics or _camera(found.world, options)
        points = _rays(camera) * depth[..., None]
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
            notes=(f"mock: true points in an unknown unit{options.noted}",),
            up=None if options.up_sigma is None else _drawn_up(found.world, options),
            up_sigma=options.up_sigma,
            up_source="" if options.up_sigma is None else "mock",
        )


def _drawn_up(world: World, options: RelativePointmapOptions) -> FloatArray:
    """Return the normal of the floor, turned by a drawn angle about each of two axes across it."""
    normal = np.asarray(world.floor.normal, np.float64)
    across = np.linalg.svd(normal[None])[2][1:]
    drawn = seeded_rng(world, options.noise_seed, "up").normal(size=2)
    up = normal + options.noise * np.radians(_UP_SIGMA_DEG) * drawn @ across
    return np.asarray(up / np.linalg.norm(up))


def _noisy_depth(found: RecognisedWorld, hints: Hints, options: MockOptions) -> FloatArray:
    """Return the depth map (H, W) with all shape errors, m; NaN in the sky."""
    world = found.world
    seed = options.noise_seed
    noise = options.noise
    depth = _visible_depth(found, hints, options)
    for i, mask in enumerate(world.masks):
        drawn = (
            _PERSON_BIAS + _PERSON_SIGMA * seeded_rng(world, seed, f"depth of person {i}").normal()
        )
        depth = flatten_relief(
            depth, mask & found.people, min(1.0, noise * _RELIEF_LOST), noise * drawn
        )
        # What somebody holds is as far away as they are, also to a network.
        held = [
            item
            for k, item in enumerate(found.items)
            if found.present[i] and (world.touched_item[i] == k).any()
        ]
        depth = (
            np.where(np.any(held, axis=0), depth * np.exp(noise * drawn), depth) if held else depth
        )
    depth = blur_depth_edges(depth, noise * scale_to_image(_SMEAR_PX, depth.shape))
    depth = add_hole_noise(
        depth, hints.hole, noise * _HOLE_SIGMA, _HOLE_WAVES, seeded_rng(world, seed, "hole")
    )
    for sigma, waves, purpose in (
        (_BUMP_SIGMA, _BUMP_WAVES, "bumps"),
        (_WARP_SIGMA, _WARP_WAVES, "point map"),
        (_DISAGREEMENT_SIGMA, _DISAGREEMENT_WAVES, f"point map of the {_image_kind(found)}"),
    ):
        depth = add_smooth_noise(depth, noise * sigma, waves, seeded_rng(world, seed, purpose))
    return np.where(np.isfinite(depth), depth, np.nan)


def _scale_and_shift(
    found: RecognisedWorld, depth: FloatArray, options: RelativePointmapOptions
) -> tuple[float, float]:
    """Draw the scale and shift of an image's point map; a drawn shift keeps all points in front."""
    common = seeded_rng(found.world, options.noise_seed, "unit of both").normal()
    own = seeded_rng(found.world, options.noise_seed, "unit of the photo").normal()
    own = own if _image_kind(found) == "photo" else 0.0
    scale = options.scale * math.exp(
        options.noise * (_UNIT_SIGMA * common + _PHOTO_UNIT_SIGMA * own)
    )
    if options.unknown == "scale":
        return scale, 0.0
    if options.shift is not None:
        return scale, options.shift
    return scale, _drawn_offset(
        found, depth, options
    ) if options.unknown == "inverse_scale_shift" else 0.0


def _image_kind(found: RecognisedWorld) -> str:
    """Return "photo" if a person is visible, else "empty"."""
    return "photo" if found.present.any() else "empty"


def _visible_depth(found: RecognisedWorld, hints: Hints, options: MockOptions) -> FloatArray:
    """Return the depth map of what the image shows; people may have been removed from it.

    With noise, the depth of a hole is interpolated from around: hidden furniture is not known.
    """
    shown = found.people | found.items.any(axis=0)
    depth = np.where(shown, found.world.depth, found.world.empty_depth).astype(np.float64)
    if options.noise == 0 or hints.hole is None:
        return depth
    # Inverse depth, which is linear on a plane, and zero in the sky.
    hole = hints.hole & ~shown
    inverse = fill_from_surroundings(1 / depth[..., None], hole)[..., 0]
    with np.errstate(divide="ignore"):
        return np.where(hole, 1 / inverse, depth)


def _drawn_offset(found: RecognisedWorld, depth: FloatArray, options: MockOptions) -> float:
    """Return the offset of inverse depth, 1 / metres: a share of the inverse depth of the farthest
    surfaces.

    Above 0, what is far comes out too far. The relative point map leaves the offset open; the
    metric depth has it as an error that is 0 in the middle of the floor.
    """
    draw = seeded_rng(found.world, options.noise_seed, "offset of inverse depth").normal()
    share = min(options.noise * (_OFFSET_SHARE + _OFFSET_SIGMA * draw), _MOST_OFFSET)
    return share / float(np.quantile(depth[np.isfinite(depth)], _FAR))


def _bent(depth: FloatArray, offset: float, floor: BoolArray) -> FloatArray:
    """Return the depth map after an offset of inverse depth, unchanged at the median depth of the
    floor.
    """
    if offset == 0:
        return depth
    known = np.isfinite(depth)
    middle = float(np.median(depth[known & floor] if (known & floor).any() else depth[known]))
    with np.errstate(invalid="ignore", divide="ignore"):
        inverse = (1 / depth - offset) / (1 - offset * middle)
        return np.where(known & (inverse > 0), 1 / inverse, np.nan)


def _distance_error(found: RecognisedWorld, hints: Hints) -> float:
    """Return the geometric mean of the given bodies' distance over the true one; 1 without a body
    of this world.
    """
    assert hints.bodies is not None
    assert hints.people is not None
    world = found.world
    if hints.bodies.body_model != world.body_model or not len(hints.people):
        return 1.0
    rows = match_masks_to_world(
        replace(found, present=np.ones(len(world.masks), bool)), hints.people
    )
    true = world.joints[rows, 0, 2].astype(np.float64)
    own = true + hints.bodies.parameters.transl[:, 2] - world.parameters.transl[rows, 2]
    return float(np.exp(np.mean(np.log(np.maximum(own, 0.1 * true) / true))))


def _camera(world: World, options: MockOptions) -> Intrinsics:
    """Return the camera with a focal length error."""
    draw = seeded_rng(world, options.noise_seed, "focal length of the both depths").normal()
    factor = math.exp(options.noise * (_FOCAL_BIAS + _FOCAL_SIGMA * draw))
    true = world.intrinsics
    return replace(true, fx=true.fx * factor, fy=true.fy * factor, source="mock")


def _rays(camera: Intrinsics) -> FloatArray:
    """Return the rays (H, W, 3) with z = 1 through the pixel centres."""
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1
    )
