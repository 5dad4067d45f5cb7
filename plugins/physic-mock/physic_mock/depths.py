"""Mocks of depth networks: the world's depth with an error of scale, a low-frequency warp, and an unknown unit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import DepthMap, Pointmap
from physic_mock.noise import generator, smooth_image
from physic_mock.recognition import MockOptions, Recognised, recognise

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, Intrinsics, UInt8Array

__all__ = ["MockMetricDepth", "MockRelativePointmap"]

_WAVES = 2.5  # across the longer side of the image


class DepthOptions(MockOptions):
    """Settings that both depth mocks share."""

    warp: float = Field(0.005, ge=0, le=0.5, description="Standard deviation of a smooth error of log depth.")
    knows_camera: bool = Field(True, description="Whether the intrinsics are answered.")
    focal_error: float = Field(1.0, gt=0, description="Factor on the focal length that is answered.")


class MetricDepthOptions(DepthOptions):
    """Settings of :class:`MockMetricDepth`."""

    scale: float = Field(1.1, gt=0, description="Factor on the true depth.")
    warp: float = Field(0.02, ge=0, le=0.5, description="Standard deviation of a smooth error of log depth.")


class MockMetricDepth(interfaces.MetricDepth):
    """The world's depth times a wrong scale."""

    Options = MetricDepthOptions

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) of a world, people in or out -> z-depth in metres, of what the image shows.

        Raises:
            BackendError: the image shows no world that the options name.
        """
        assert isinstance(self.options, MetricDepthOptions)
        found = recognise(image, self.options, hints.hole)
        depth = _seen_depth(found) * self.options.scale
        depth = depth * _warp(found, self.options, "metric depth", self.options.warp)
        return DepthMap(
            depth=depth.astype(np.float32),
            intrinsics=_camera(found, self.options),
            scale_sigma=max(abs(float(np.log(self.options.scale))), 0.02),
            notes=(f"mock: true depth times {self.options.scale:g}",),
        )


class RelativePointmapOptions(DepthOptions):
    """Settings of :class:`MockRelativePointmap`."""

    unknown: Literal["scale", "scale_shift", "inverse_scale_shift"] = Field(
        "scale_shift", description="What the answer leaves open."
    )
    scale: float = Field(1.4, gt=0, description="The unknown scale: Z = s Z', Z = s Z' + t or 1 / Z = s / Z' + t.")
    shift: float | None = Field(
        None, description="The unknown shift t; None: 0.25 m of Z, or 0.04 / m of 1 / Z. Unused where there is none."
    )
    photo_scale: float = Field(1.15, gt=0, description="The photo with its people has this many times the scale.")
    disagreement: float = Field(
        0.003, ge=0, le=0.5, description="A further smooth error of log depth, of its own in each of the two images."
    )


class MockRelativePointmap(interfaces.RelativePointmap):
    """The world's point map in an unknown unit, of its own for the photo and for the picture without people."""

    Options = RelativePointmapOptions

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Image (H, W, 3) of a world, people in or out -> point map on the rays of ``hints.intrinsics`` if given.

        Raises:
            BackendError: the image shows no world that the options name.
        """
        assert isinstance(self.options, RelativePointmapOptions)
        options = self.options
        found = recognise(image, options, hints.hole)
        which = "photo" if found.present.any() else "empty"
        depth = _seen_depth(found) * _warp(found, options, "point map", options.warp)
        depth = depth * _warp(found, options, f"point map of the {which}", options.disagreement)
        scale = options.scale * (options.photo_scale if which == "photo" else 1.0)
        camera = hints.intrinsics or found.world.intrinsics
        points = _rays(camera) * depth[..., None]
        if options.unknown == "inverse_scale_shift":
            shift = 0.04 if options.shift is None else options.shift
            relative = points / depth[..., None] * (scale / (1 / depth - shift))[..., None]
        else:
            shift = 0.25 if options.shift is None else options.shift
            moved = [0, 0, shift if options.unknown == "scale_shift" else 0.0]
            relative = (points - moved) / scale
        return Pointmap(
            points=relative.astype(np.float32),
            valid=np.isfinite(relative).all(axis=2) & (relative[..., 2] > 0),
            unknown=options.unknown,
            intrinsics=hints.intrinsics or _camera(found, options),
            notes=("mock: true points in an unknown unit",),
        )


def _seen_depth(found: Recognised) -> FloatArray:
    return np.where(found.people, found.world.depth, found.world.empty_depth).astype(np.float64)


def _warp(found: Recognised, options: DepthOptions, purpose: str, amount: float) -> FloatArray:
    rng = generator(found.world, options.noise_seed, purpose)
    factor: FloatArray = np.exp(amount * smooth_image(found.people.shape, _WAVES, rng))
    return factor


def _camera(found: Recognised, options: DepthOptions) -> Intrinsics | None:
    if not options.knows_camera:
        return None
    true = found.world.intrinsics
    return replace(true, fx=true.fx * options.focal_error, fy=true.fy * options.focal_error, source="mock")


def _rays(camera: Intrinsics) -> FloatArray:
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
