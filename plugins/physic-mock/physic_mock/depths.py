"""Mocks of depth estimators: true depth with scale error or ambiguity, and with shape errors."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import DepthMap, Pointmap
from physic_mock.depth_noise import add_hole_noise, add_smooth_noise, blur_depth_edges, flatten_relief
from physic_mock.fill import fill_from_surroundings
from physic_mock.noise import scale_to_image, seeded_rng
from physic_mock.recognition import MockOptions, RecognisedWorld, match_masks_to_world, recognise_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Hints, Intrinsics, UInt8Array
    from physic_testing.worlds import World

_LEAST_SIGMA = 1e-3  # of log scale: 0 is not a standard deviation
_WARP_WAVES = 2.0  # across the longer side of the image
_DISAGREEMENT_WAVES = 3.0
_BUMP_WAVES = 16.0
_HOLE_WAVES = 6.0
_FAR = 0.95  # quantile of the depth of what counts as farthest
_MOST_OFFSET = 0.95  # of the inverse depth there
_MOST_SHIFT = 0.5  # of the nearest depth, so that all of it stays in front of the camera


_SHAPE_4: dict[str, Any] = {
    "focal_error": 1.2,
    "one_camera": True,
    "hole_depth": "surroundings",
    "offset_share": 0.6,
    "offset_sigma": 0.4,
}
"""Defaults of version 4 of both depth mocks: one network stands behind both."""


class DepthOptions(MockOptions):
    """Options of both depth mocks."""

    warp: float = Field(0.025, ge=0, le=0.5, description="Standard deviation of a low-frequency error of log depth.")
    smear_px: float = Field(
        2.0, ge=0, le=20, description="Width of the blur of depth edges, px of a photo 640 px wide."
    )
    knows_camera: bool = Field(True, description="Whether the intrinsics are returned.")
    focal_error: float = Field(1.0, ge=1e-6, le=1e3, description="Factor on the focal length besides the drawn one.")
    focal_sigma: interfaces.Share = Field(
        0.07, description="Standard deviation of the logarithm of the focal length, drawn once a world."
    )

    one_camera: bool = Field(
        False, description="Whether both depth mocks draw one focal length, and take the one that they are given."
    )
    hole_depth: Literal["truth", "surroundings"] = Field(
        "truth",
        description="Depth where an inpainter made the picture up: the true one, or interpolated from around.",
    )
    offset_share: float | None = Field(
        None,
        ge=-1,
        lt=1,
        description="Mean of the unknown offset of inverse depth, as a share of the inverse depth of the farthest "
        "surfaces: above 0, what is far comes out too far. The relative point map leaves it open, the metric depth has "
        "it as an error that is 0 in the middle of the floor. None: the metric depth has none.",
    )
    offset_sigma: float = Field(
        0.0,
        ge=0,
        le=2,
        description="Standard deviation of that share, which is drawn once a world and is at most 0.95.",
    )


class MetricDepthOptions(DepthOptions):
    """Options of :class:`MockMetricDepth`."""

    VERSION_4: ClassVar = {**_SHAPE_4, "scale_sigma": 0.09, "as_pointmap": True, "scale_by_bodies": True}

    as_pointmap: bool = Field(
        False, description="Whether the shape is the one of version 4's relative point map, with all of its errors."
    )
    scale_by_bodies: bool = Field(
        False, description="Whether the mean error of the given bodies' distances is an error of the scale, too."
    )

    scale: float = Field(1.0, ge=1e-6, le=1e6, description="Factor on the true depth besides the drawn one.")
    scale_sigma: interfaces.Share = Field(
        0.08, description="Standard deviation of the logarithm of that factor, drawn once a world."
    )
    stated_sigma: float | None = Field(
        None, ge=0, le=10, description="Returned standard deviation of log scale; None: the true one of the draws."
    )
    warp: float = Field(0.035, ge=0, le=0.5, description="Standard deviation of a low-frequency error of log depth.")


class MockMetricDepth(interfaces.MetricDepth):
    """Metric depth estimator that returns a world's depth with a scale error.

    A focal length error scales the depth by the same factor, as in networks that infer depth from sizes in px.
    """

    Options = MetricDepthOptions
    options: MetricDepthOptions

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return the depth map of a world's photo, with or without people, m; NaN in the sky.

        Raises:
            BackendError: the image shows no world.
        """
        options, noise = self.options, self.options.noise
        found = recognise_world(image, hints.hole)
        world, seed = found.world, options.noise_seed
        camera = _camera(world, options, "metric depth", hints)
        drawn = math.exp(noise * options.scale_sigma * seeded_rng(world, seed, "metric scale").normal())
        if options.as_pointmap:
            shape = RelativePointmapOptions(version=4, noise=noise, noise_seed=seed, hole_depth=options.hole_depth)
            depth = _noisy_depth(found, hints, shape)
        else:
            smear_px = noise * scale_to_image(options.smear_px, found.people.shape)
            depth = blur_depth_edges(_visible_depth(found, hints, options), smear_px)
            depth = add_smooth_noise(depth, noise * options.warp, _WARP_WAVES, seeded_rng(world, seed, "metric depth"))
        if options.offset_share is not None:
            depth = _bent(depth, _drawn_offset(found, depth, options), world.empty_floor_mask)
        if options.scale_by_bodies and hints.bodies is not None and hints.people is not None:
            depth = depth * options.scale * drawn * _distance_error(found, hints)
        else:
            depth = depth * options.scale * drawn * camera.fx / world.intrinsics.fx
        own_sigma = noise * math.hypot(options.scale_sigma, options.focal_sigma)
        stated = "" if options.scale == 1 else f" times {options.scale:g}"
        return DepthMap(
            depth=np.where(np.isfinite(depth), depth, np.nan).astype(np.float32),
            intrinsics=camera if options.knows_camera else None,
            scale_sigma=max(own_sigma, _LEAST_SIGMA) if options.stated_sigma is None else options.stated_sigma,
            notes=(f"mock: true depth{stated} with errors of noise model {options.version} times {noise:g}",),
        )


class RelativePointmapOptions(DepthOptions):
    """Options of :class:`MockRelativePointmap`."""

    VERSION_4: ClassVar = {
        **_SHAPE_4,
        "unknown": "inverse_scale_shift",
        "warp": 0.012,
        "bumps": 0.007,
        "disagreement": 0.014,
        "hole_noise": 0.03,
        "person_offset": 0.08,
        "person_bias": 0.1,
    }

    unknown: Literal["scale", "scale_shift", "inverse_scale_shift"] = Field(
        "scale_shift", description="Ambiguity of the returned point map."
    )
    scale: float = Field(
        1.0,
        ge=1e-6,
        le=1e6,
        description="The unknown scale besides the drawn one: Z = s Z', Z = s Z' + t or 1 / Z = s / Z' + t.",
    )
    scale_sigma: float = Field(0.3, ge=0, le=2, description="Standard deviation of the logarithm of that scale.")
    shift: float | None = Field(
        None,
        ge=-1e6,
        le=1e6,
        description="The unknown shift t, metres or 1 / metres; None draws it. Unused where there is none.",
    )
    shift_sigma: interfaces.Share = Field(
        0.08, description="Standard deviation of the drawn shift, as a share of the median (inverse) depth."
    )
    photo_scale_sigma: float = Field(
        0.15, ge=0, le=2, description="How far the photo with its people has another scale: standard deviation of log."
    )
    photo_shift_sigma: interfaces.Share = Field(
        0.03, description="How far it has another drawn shift, as a share of the median (inverse) depth."
    )
    disagreement: float = Field(
        0.025, ge=0, le=0.5, description="A further smooth error of log depth, of its own in each of the two images."
    )
    hole_noise: float = Field(
        0.05, ge=0, le=0.5, description="A further error of log depth where an inpainter made the picture up."
    )
    bumps: float = Field(
        0.01, ge=0, le=0.5, description="Standard deviation of bumps of log depth, a sixteenth of the picture wide."
    )
    relief_lost: interfaces.Share = Field(
        0.3, description="Share of people's relief about their own median depth that is flatten_relief."
    )
    person_offset: float = Field(
        0.05, ge=0, le=0.5, description="Standard deviation of log depth by which a person is shifted."
    )
    person_bias: float = Field(
        -0.03,
        ge=-0.5,
        le=0.5,
        description="Mean of that error: below 0, people come out nearer than what they stand or sit on.",
    )


class MockRelativePointmap(interfaces.RelativePointmap):
    """Point map estimator that returns a world's points with unknown scale and shift, drawn per image."""

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
        camera = hints.intrinsics or _camera(found.world, options, "point map", hints)
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
            intrinsics=camera if hints.intrinsics or options.knows_camera else None,
            notes=(
                f"mock: true points in an unknown unit with errors of noise model {options.version} "
                f"times {options.noise:g}",
            ),
        )


def _noisy_depth(found: RecognisedWorld, hints: Hints, options: RelativePointmapOptions) -> FloatArray:
    """Return the depth map (H, W) with all shape errors, m; NaN in the sky."""
    world, seed, noise = found.world, options.noise_seed, options.noise
    which = _image_kind(found)
    depth = _visible_depth(found, hints, options)
    for i, mask in enumerate(world.masks):
        drawn = options.person_bias + options.person_offset * seeded_rng(world, seed, f"depth of person {i}").normal()
        depth = flatten_relief(depth, mask & found.people, min(1.0, noise * options.relief_lost), noise * drawn)
        # What somebody holds is as far away as they are, also to a network.
        held = [item for k, item in enumerate(found.items) if found.present[i] and (world.touched_item[i] == k).any()]
        depth = np.where(np.any(held, axis=0), depth * np.exp(noise * drawn), depth) if held else depth
    depth = blur_depth_edges(depth, noise * scale_to_image(options.smear_px, depth.shape))
    depth = add_hole_noise(depth, hints.hole, noise * options.hole_noise, _HOLE_WAVES, seeded_rng(world, seed, "hole"))
    for sigma, waves, purpose in (
        (options.bumps, _BUMP_WAVES, "bumps"),
        (options.warp, _WARP_WAVES, "point map"),
        (options.disagreement, _DISAGREEMENT_WAVES, f"point map of the {which}"),
    ):
        depth = add_smooth_noise(depth, noise * sigma, waves, seeded_rng(world, seed, purpose))
    return np.where(np.isfinite(depth), depth, np.nan)


def _scale_and_shift(
    found: RecognisedWorld, depth: FloatArray, options: RelativePointmapOptions
) -> tuple[float, float]:
    """Draw the scale and shift of an image's point map; a drawn shift keeps all points in front."""
    common = seeded_rng(found.world, options.noise_seed, "unit of both").normal(size=2)
    own = seeded_rng(found.world, options.noise_seed, "unit of the photo").normal(size=2)
    own = own if _image_kind(found) == "photo" else np.zeros(2)
    log_scale = options.scale_sigma * common[0] + options.photo_scale_sigma * own[0]
    scale = options.scale * math.exp(options.noise * log_scale)
    if options.unknown == "scale":
        return scale, 0.0
    if options.shift is not None:
        return scale, options.shift
    if options.offset_share is not None and options.unknown == "inverse_scale_shift":
        return scale, _drawn_offset(found, depth, options)
    known = depth[np.isfinite(depth)]
    known = 1 / known if options.unknown == "inverse_scale_shift" else known
    shift = options.noise * (options.shift_sigma * common[1] + options.photo_shift_sigma * own[1]) * np.median(known)
    return scale, float(min(shift, _MOST_SHIFT * known.min()))


def _image_kind(found: RecognisedWorld) -> str:
    """Return "photo" if a person is visible, else "empty"."""
    return "photo" if found.present.any() else "empty"


def _visible_depth(found: RecognisedWorld, hints: Hints, options: DepthOptions) -> FloatArray:
    """Return the depth map of an image from which some people may be removed."""
    shown = found.people | found.items.any(axis=0)
    depth = np.where(shown, found.world.depth, found.world.empty_depth).astype(np.float64)
    if options.hole_depth == "truth" or options.noise == 0 or hints.hole is None:
        return depth
    # Inverse depth, which is linear on a plane, and zero in the sky.
    hole = hints.hole & ~shown
    inverse = fill_from_surroundings(1 / depth[..., None], hole)[..., 0]
    with np.errstate(divide="ignore"):
        return np.where(hole, 1 / inverse, depth)


def _drawn_offset(found: RecognisedWorld, depth: FloatArray, options: DepthOptions) -> float:
    """Return the offset of inverse depth, 1 / metres: a share of the inverse depth of the farthest surfaces."""
    assert options.offset_share is not None
    draw = seeded_rng(found.world, options.noise_seed, "offset of inverse depth").normal()
    share = min(options.noise * (options.offset_share + options.offset_sigma * draw), _MOST_OFFSET)
    return share / float(np.quantile(depth[np.isfinite(depth)], _FAR))


def _bent(depth: FloatArray, offset: float, floor: BoolArray) -> FloatArray:
    """Return the depth map after an offset of inverse depth, unchanged at the median depth of the floor."""
    known = np.isfinite(depth)
    middle = float(np.median(depth[known & floor] if (known & floor).any() else depth[known]))
    with np.errstate(invalid="ignore", divide="ignore"):
        inverse = (1 / depth - offset) / (1 - offset * middle)
        return np.where(known & (inverse > 0), 1 / inverse, np.nan)


def _distance_error(found: RecognisedWorld, hints: Hints) -> float:
    """Return the geometric mean of the given bodies' distance over the true one; 1 without a body of this world."""
    assert hints.bodies is not None
    assert hints.people is not None
    world = found.world
    if hints.bodies.body_model != world.body_model or not len(hints.people):
        return 1.0
    rows = match_masks_to_world(replace(found, present=np.ones(len(world.masks), bool)), hints.people)
    true = world.joints[rows, 0, 2].astype(np.float64)
    own = true + hints.bodies.parameters.transl[:, 2] - world.parameters.transl[rows, 2]
    return float(np.exp(np.mean(np.log(np.maximum(own, 0.1 * true) / true))))


def _camera(world: World, options: DepthOptions, purpose: str, hints: Hints) -> Intrinsics:
    """Return the camera with a focal length error."""
    if options.one_camera:
        if hints.intrinsics is not None:
            return hints.intrinsics
        purpose = "both depths"
    draw = seeded_rng(world, options.noise_seed, f"focal length of the {purpose}").normal()
    factor = options.focal_error * math.exp(options.noise * options.focal_sigma * draw)
    true = world.intrinsics
    return replace(true, fx=true.fx * factor, fy=true.fy * factor, source="mock")


def _rays(camera: Intrinsics) -> FloatArray:
    """Return the rays (H, W, 3) with z = 1 through the pixel centres."""
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
