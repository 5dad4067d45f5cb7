"""Depth Anything: V2 in metres, and V2 or 3 up to scale and shift, from the many ONNX exports that are about.

V2 relative answers disparity, larger is nearer. V2 metric answers metres. Depth Anything 3 relative answers depth,
larger is farther, and some of its files a camera too. Names of inputs and outputs do not tell V2 metric from relative:
the last activation does, a sigmoid in the metric one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, RelativePointmap

from .contract import Dialect, Wanted
from .depth_anything_forms import has_sigmoid, last_part, names_version_3, normalises_itself
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import (
        AffineAmbiguity,
        BoolArray,
        DepthMap,
        FloatArray,
        Hints,
        Intrinsics,
        Pointmap,
        UInt8Array,
    )

    from .one_graph import Speaking

__all__ = [
    "DepthAnythingMetric",
    "DepthAnythingMetricOptions",
    "DepthAnythingRelative",
    "DepthAnythingRelativeOptions",
    "prepare",
]

PATCH = 14  # px
_SKY_SCORE = 0.3  # of Depth Anything 3, from here on it is sky
_SATURATED = 0.98  # of the largest depth that a metric network can say
_LARGEST = {"indoor": 20.0, "hypersim": 20.0, "outdoor": 80.0, "vkitti": 80.0}

_PICTURE = Wanted("pixel_values", ("image", "input", "l_x_"), shape=(None, 3, None, None))
_ONE_VIEW = Wanted("pixel_values", ("image",), shape=(None, 1, 3, None, None))
_DEPTH = Wanted("predicted_depth", ("depth", "output"))
_EXTRAS = (
    Wanted("sky", optional=True),
    Wanted("intrinsics", optional=True),
    Wanted("depth_conf", ("confidence", "predicted_confidence"), optional=True),
)
VIEWS, PUBLISHED, OTHER = "Depth Anything 3 of several views", "a published file", "an export of other names"

Pixels = Literal["auto", "imagenet", "0-255"]
_PIXELS = (
    "what the file takes: 'imagenet' normalised values, '0-255' where it normalises itself; 'auto' tells by its ports"
)
_PATCHES = "cap on 14 px patches, which limits the time of long panoramas"


class DepthAnythingMetricOptions(OneGraphOptions):
    """Settings of Depth Anything V2 metric."""

    weights: str = Field("depth-anything-v2-metric-indoor-small", description=WEIGHTS)
    side: int = Field(518, ge=56, multiple_of=14, description="px of the input's side where the file leaves it free")
    max_patches: int = Field(5000, ge=64, description=_PATCHES)
    pixels: Pixels = Field("auto", description=_PIXELS)
    farthest: float | None = Field(
        None, gt=0, description="metres; farther is not known; none takes 98 % of the most that the network can say"
    )
    trust: bool = Field(False, description="take the file for a metric one though its last activation says relative")


class DepthAnythingRelativeOptions(OneGraphOptions):
    """Settings of Depth Anything V2 or 3 relative."""

    weights: str = Field("depth-anything-v2-small", description=WEIGHTS)
    side: int | None = Field(
        None,
        ge=56,
        multiple_of=14,
        description="px of the input where the file leaves it free: 518, or 504 of 3",
    )
    max_patches: int = Field(5000, ge=64, description=_PATCHES)
    pixels: Pixels = Field("auto", description=_PIXELS)
    answers: Literal["auto", "disparity", "depth"] = Field(
        "auto", description="V2 answers disparity and 3 answers depth; 'auto' tells by the file's ports and its name"
    )
    default_fov: float = Field(
        55.5, gt=5, lt=150, description="field of view, degrees along the long side, where no camera is known"
    )
    trust: bool = Field(False, description="take the file for a relative one though its last activation says metric")


class DepthAnythingMetric(OneGraph, MetricDepth):
    """Depth in metres by Depth Anything V2, trained indoors (to 20 m) or on streets (to 80 m); it knows no camera."""

    Options: ClassVar[type[OneGraphOptions]] = DepthAnythingMetricOptions
    options: DepthAnythingMetricOptions
    dialects: ClassVar = {
        PUBLISHED: Dialect((_PICTURE,), (_DEPTH,)),
        OTHER: Dialect((_PICTURE,), (_DEPTH,), by_position=True),
    }

    def check_file(self, path: Path) -> None:
        """Refuse a relative file.

        Raises:
            BackendError: its graph holds no sigmoid.
        """
        if not self.options.trust and not has_sigmoid(path):
            raise BackendError(
                f"{path.name} does not end in a sigmoid, as the metric networks of Depth Anything V2 do: it answers "
                "relative disparity. Use it as relative_pointmap 'depth-anything-onnx', or name metric weights; "
                "trust = true takes it for metric all the same"
            )

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> metres along z, NaN where the network is at its end."""
        from physic_core.adapters.pictures import resize_map
        from physic_core.types import DepthMap

        from .depth_maps import depth_at

        speaking = self.speaking()
        rows, columns = _size(speaking, image, self.options.side, self.options.max_patches)
        (values, *_), notes = _ask(speaking, image, rows, columns, self.options.pixels)
        metres = resize_map(values, *image.shape[:2])
        return DepthMap(depth_at(metres, self._farthest()), notes=notes)

    def _farthest(self) -> float | None:
        if self.options.farthest is not None:
            return self.options.farthest
        names = f"{last_part(self.options.weights)} {self.speaking().network.name}".lower()
        return next((_SATURATED * most for word, most in _LARGEST.items() if word in names), None)


class DepthAnythingRelative(OneGraph, RelativePointmap):
    """Points up to scale, or up to scale and shift, by Depth Anything V2 or 3 relative."""

    Options: ClassVar[type[OneGraphOptions]] = DepthAnythingRelativeOptions
    options: DepthAnythingRelativeOptions
    dialects: ClassVar = {
        VIEWS: Dialect((_ONE_VIEW,), (_DEPTH, *_EXTRAS)),
        PUBLISHED: Dialect((_PICTURE,), (_DEPTH, *_EXTRAS)),
        OTHER: Dialect((_PICTURE,), (_DEPTH,), by_position=True),
    }

    def check_file(self, path: Path) -> None:
        """Refuse a metric file of V2.

        Raises:
            BackendError: its graph ends in a sigmoid.
        """
        if not self.options.trust and not names_version_3(path.name) and has_sigmoid(path):
            raise BackendError(
                f"{path.name} holds a sigmoid, as the metric networks of Depth Anything V2 do: it answers metres, and "
                "not disparity. Use it as metric_depth 'depth-anything-v2-metric-onnx', or name relative weights; "
                "trust = true takes it for relative all the same"
            )

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Image (H, W, 3) -> points; what ``unknown`` names is open, and the median depth is 1.

        Raises:
            BackendError: the network is not loaded, or sees nothing.
        """

        from physic_core.adapters.disparity import clip_disparity, points_from_disparity
        from physic_core.types import Pointmap

        from .depth_maps import single_map

        speaking = self.speaking()
        third = self._answers_depth(speaking)
        rows, columns = self._size(speaking, image, third)
        extras = tuple(name for name in ("sky", "intrinsics") if speaking.has(name))
        (values, *more), notes = _ask(speaking, image, rows, columns, self.options.pixels, *extras)
        told = dict(zip(extras, more, strict=True))
        gap, lost = _inverse_depth(values) if third else clip_disparity(values)
        if "sky" in told:
            lost |= single_map(told["sky"], "sky", speaking.network.name, may_be_flat=True) >= _SKY_SCORE
        if lost.all():
            raise BackendError(f"{speaking.network.name} saw no structure in the photo: no pixel has a depth")
        camera, said = self._camera(hints, image, told.get("intrinsics"), values.shape)
        points, valid = points_from_disparity(np.where(lost, gap[~lost].min(), gap), lost, camera)
        return Pointmap(points, valid, _open(speaking, third), camera, (*said, *notes))

    def _answers_depth(self, speaking: Speaking) -> bool:
        if self.options.answers != "auto":
            return self.options.answers == "depth"
        names = f"{last_part(self.options.weights)} {speaking.network.name}"
        third = speaking.dialect == VIEWS or any(speaking.has(extra.name) for extra in _EXTRAS)
        return third or names_version_3(names)

    def _size(self, speaking: Speaking, image: UInt8Array, third: bool) -> tuple[int, int]:
        from physic_core.adapters.patch_grid import input_size_by_long_side, limit_patches

        if not third:
            return _size(speaking, image, self.options.side or 518, self.options.max_patches)
        height, width = image.shape[:2]
        free = limit_patches(
            *input_size_by_long_side(height, width, self.options.side or 504, PATCH), self.options.max_patches
        )
        return _fixed_or(speaking, free)

    def _camera(
        self, hints: Hints, image: UInt8Array, matrix: FloatArray | None, seen: tuple[int, ...]
    ) -> tuple[Intrinsics, tuple[str, ...]]:
        """The camera that is known, else the network's, else a default; and notes."""
        from physic_core.adapters.cameras import guessed_camera, known_camera

        known = known_camera(hints, image)
        if known is not None:
            return known, ()
        if matrix is not None:
            height, width = image.shape[:2]
            own = _camera_of(matrix, seen).resized(width, height)
            return own, (f"focal length {own.fx:.0f} px from Depth Anything 3",)
        return guessed_camera(self.options.default_fov, image)


def prepare(image: UInt8Array, rows: int, columns: int, *, normalised: bool = True) -> FloatArray:
    """Image (H, W, 3) -> (1, 3, rows, columns): bicubic with antialiasing, in 8 bits as published, then ImageNet's.

    Args:
        image: uint8 RGB.
        rows: of the input.
        columns: of the input.
        normalised: false leaves 0..255.
    """
    from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw, resize_image

    small = resize_image(image, rows, columns, "bicubic-antialias")
    return normalized_nchw(small, IMAGENET_MEAN, IMAGENET_STD) if normalised else normalized_nchw(small, scale=1.0)


def _size(speaking: Speaking, image: UInt8Array, side: int, most: int) -> tuple[int, int]:
    from physic_core.adapters.patch_grid import input_size_least_scaling, limit_patches

    height, width = image.shape[:2]
    return _fixed_or(speaking, limit_patches(*input_size_least_scaling(height, width, side, PATCH), most))


def _fixed_or(speaking: Speaking, free: tuple[int, int]) -> tuple[int, int]:
    """What the file fixes, and the rest of a size of our choice."""
    from .depth_maps import fixed_size

    rows, columns = fixed_size(speaking.shape("pixel_values"))
    return rows or free[0], columns or free[1]


def _ask(
    speaking: Speaking, image: UInt8Array, rows: int, columns: int, pixels: Pixels, *extras: str
) -> tuple[list[FloatArray], tuple[str, ...]]:
    """The map of depth or disparity (h, w), further outputs as they come, and notes."""
    from .depth_maps import single_map, squash_note

    normalised = pixels == "imagenet" or (pixels == "auto" and not normalises_itself(speaking))
    fed = prepare(image, rows, columns, normalised=normalised)
    raw, *more = speaking.ask("pixel_values", fed, "predicted_depth", *extras)
    values = single_map(raw, "predicted_depth", speaking.network.name)
    fixed = speaking.ports.inputs["pixel_values"].shape[-2:] == (rows, columns)
    return [values, *more], squash_note(image, rows, columns, speaking.network.name) if fixed else ()


def _inverse_depth(depth: FloatArray) -> tuple[FloatArray, BoolArray]:
    """1 / depth and where there is none; both (h, w)."""

    with np.errstate(invalid="ignore"):
        lost = ~(np.isfinite(depth) & (depth > 0))
    return 1 / np.where(lost, 1.0, depth), lost


def _open(speaking: Speaking, third: bool) -> AffineAmbiguity:
    """What the answer leaves open; networks of several views find a camera, and so no shift is left."""
    if not third:
        return "inverse_scale_shift"
    views = speaking.dialect == VIEWS or speaking.has("intrinsics") or speaking.has("depth_conf")
    return "scale" if views else "scale_shift"


def _camera_of(matrix: FloatArray, seen: tuple[int, ...]) -> Intrinsics:
    """A camera matrix (..., 3, 3) of the network's picture, whose coordinates count from the picture's corner."""
    from physic_core.types import Intrinsics

    k = matrix.reshape(-1, 3, 3)[0]
    rows, columns = seen
    return Intrinsics(
        float(k[0, 0]),
        float(k[1, 1]),
        float(k[0, 2]) - 0.5,
        float(k[1, 2]) - 0.5,
        columns,
        rows,
        "Depth Anything 3",
    )
