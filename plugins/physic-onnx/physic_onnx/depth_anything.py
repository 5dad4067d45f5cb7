"""Estimate depth with ONNX files of Depth Anything: V2 metric, V2 relative and 3 relative.

V2 relative returns disparity, larger is nearer. V2 metric returns metres. Depth Anything 3 relative
returns depth, and some of its files a camera. V2 metric and relative have the same ports; only the
metric network ends in a sigmoid.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, RelativePointmap

from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackend, OnnxBackendOptions, PortSpec

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

    from .one_graph import LoadedGraph

PATCH = 14  # px
_SKY_SCORE = 0.3  # of Depth Anything 3; above it is sky
_SATURATED = 0.98  # of the largest depth that a metric network can predict
_LARGEST = {"indoor": 20.0, "hypersim": 20.0, "outdoor": 80.0, "vkitti": 80.0}

_PICTURE = PortSpec("pixel_values", ("image", "input", "l_x_"), shape=(None, 3, None, None))
_ONE_VIEW = PortSpec("pixel_values", ("image",), shape=(None, 1, 3, None, None))
_DEPTH = PortSpec("predicted_depth", ("depth", "output"))
_EXTRAS = (
    PortSpec("sky", optional=True),
    PortSpec("intrinsics", optional=True),
    PortSpec("depth_conf", ("confidence", "predicted_confidence"), optional=True),
)
VIEWS = "Depth Anything 3 of several views"
PUBLISHED = "a published file"
OTHER = "an export of other names"

Pixels = Literal["auto", "imagenet", "0-255"]
_PIXELS = (
    "what the file takes: 'imagenet' normalised values, '0-255' where it normalises itself; "
    "'auto' tells by its ports"
)
_PATCHES = "cap on 14 px patches, which limits the time of long panoramas"


class DepthAnythingMetricOptions(OnnxBackendOptions):
    """Settings of Depth Anything V2 metric."""

    weights: str = Field("depth-anything-v2-metric-indoor-small", description=WEIGHTS_HELP)
    side: int = Field(
        518,
        ge=56,
        le=10_000,
        multiple_of=14,
        description="px of the input's side where the file leaves it free",
    )
    max_patches: int = Field(5000, ge=64, le=100_000, description=_PATCHES)
    pixels: Pixels = Field("auto", description=_PIXELS)
    farthest: float | None = Field(
        None,
        ge=1e-6,
        le=1e6,
        description="metres; larger depths become unknown; none takes 98 % of the largest depth "
        "of the network",
    )
    trust: bool = Field(
        False,
        description="use the file as metric although its last layer is that of a relative one",
    )


class DepthAnythingRelativeOptions(OnnxBackendOptions):
    """Settings of Depth Anything V2 or 3 relative."""

    weights: str = Field("depth-anything-v2-small", description=WEIGHTS_HELP)
    side: int | None = Field(
        None,
        ge=56,
        le=10_000,
        multiple_of=14,
        description="px of the input where the file leaves it free: 518, or 504 of 3",
    )
    max_patches: int = Field(5000, ge=64, le=100_000, description=_PATCHES)
    pixels: Pixels = Field("auto", description=_PIXELS)
    answers: Literal["auto", "disparity", "depth"] = Field(
        "auto",
        description="V2 returns disparity and 3 returns depth; 'auto' tells by the file's ports "
        "and its name",
    )
    default_fov: float = Field(
        55.5,
        gt=5,
        lt=150,
        description="field of view, degrees along the long side, where no camera is known",
    )
    trust: bool = Field(
        False,
        description="use the file as relative although its last layer is that of a metric one",
    )


class DepthAnythingMetric(OnnxBackend, MetricDepth):
    """Metric depth by Depth Anything V2, trained indoors (to 20 m) or on streets (to 80 m);
    estimates no camera.
    """

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = DepthAnythingMetricOptions
    options: DepthAnythingMetricOptions
    reads = ()
    signatures: ClassVar = {
        PUBLISHED: GraphSignature((_PICTURE,), (_DEPTH,)),
        OTHER: GraphSignature((_PICTURE,), (_DEPTH,), by_position=True),
    }

    def check_file(self, path: Path) -> None:
        """Raise BackendError for a file of a relative network.

        Raises:
            BackendError: its graph holds no sigmoid.
        """
        if not self.options.trust and not has_sigmoid(path):
            raise BackendError(
                f"{path.name} does not end in a sigmoid, as the metric networks of Depth Anything "
                f"V2 do: it returns "
                "relative disparity. Use it as relative_pointmap 'depth-anything-onnx', or name "
                "metric weights; "
                "trust = true uses it as metric anyway"
            )

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Predict the metric depth (H, W) of an image (H, W, 3); NaN where the network has no
        depth.
        """
        from physic_core.adapters.pictures import resize_map
        from physic_core.types import DepthMap

        from .depth_maps import mask_depth

        loaded = self.network
        rows, columns = _size(loaded, image, self.options.side, self.options.max_patches)
        (values, *_), notes = _ask(loaded, image, rows, columns, self.options.pixels)
        metres = resize_map(values, *image.shape[:2])
        return DepthMap(mask_depth(metres, self._farthest()), notes=notes)

    def _farthest(self) -> float | None:
        """Return the largest reliable depth in metres, or None."""
        if self.options.farthest is not None:
            return self.options.farthest
        names = f"{base_name(self.options.weights)} {self.network.network.name}".lower()
        return next((_SATURATED * most for word, most in _LARGEST.items() if word in names), None)


class DepthAnythingRelative(OnnxBackend, RelativePointmap):
    """Relative point map by Depth Anything V2 or 3, up to scale, or scale and shift."""

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = DepthAnythingRelativeOptions
    options: DepthAnythingRelativeOptions
    reads = ("intrinsics",)
    signatures: ClassVar = {
        VIEWS: GraphSignature((_ONE_VIEW,), (_DEPTH, *_EXTRAS)),
        PUBLISHED: GraphSignature((_PICTURE,), (_DEPTH, *_EXTRAS)),
        OTHER: GraphSignature((_PICTURE,), (_DEPTH,), by_position=True),
    }

    def check_file(self, path: Path) -> None:
        """Raise BackendError for a file of a metric network.

        Raises:
            BackendError: its graph ends in a sigmoid.
        """
        if not self.options.trust and not is_version_3_name(path.name) and has_sigmoid(path):
            raise BackendError(
                f"{path.name} holds a sigmoid, as the metric networks of Depth Anything V2 do: it "
                f"returns metres, and "
                "not disparity. Use it as metric_depth 'depth-anything-v2-metric-onnx', or name "
                "relative weights; "
                "trust = true uses it as relative anyway"
            )

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Predict the relative point map of an image (H, W, 3); points without depth are invalid.

        Raises:
            BackendError: the network is not loaded, or sees nothing.
        """

        from physic_core.types import Pointmap
        from physic_onnx.depth_maps import clip_disparity, points_from_disparity

        from .depth_maps import squeeze_map

        loaded = self.network
        third = self._answers_depth(loaded)
        rows, columns = self._size(loaded, image, third)
        extras = tuple(name for name in ("sky", "intrinsics") if loaded.has_output(name))
        (values, *more), notes = _ask(loaded, image, rows, columns, self.options.pixels, *extras)
        optional = dict(zip(extras, more, strict=True))
        gap, lost = _inverse_depth(values) if third else clip_disparity(values)
        if "sky" in optional:
            lost |= (
                squeeze_map(optional["sky"], "sky", loaded.network.name, may_be_flat=True)
                >= _SKY_SCORE
            )
        if lost.all():
            raise BackendError(
                f"{loaded.network.name} saw no structure in the photo: no pixel has a depth"
            )
        camera, said = self._camera(hints, image, optional.get("intrinsics"), values.shape)
        points, valid = points_from_disparity(np.where(lost, gap[~lost].min(), gap), lost, camera)
        return Pointmap(points, valid, _open(loaded, third), camera, (*said, *notes))

    def _answers_depth(self, loaded: LoadedGraph) -> bool:
        """Return whether the file predicts depth in place of disparity."""
        if self.options.answers != "auto":
            return self.options.answers == "depth"
        names = f"{base_name(self.options.weights)} {loaded.network.name}"
        third = loaded.signature == VIEWS or any(loaded.has_output(extra.name) for extra in _EXTRAS)
        return third or is_version_3_name(names)

    def _size(self, loaded: LoadedGraph, image: UInt8Array, third: bool) -> tuple[int, int]:
        """Return the input size (rows, columns)."""
        from physic_onnx.depth_maps import input_size_by_long_side, limit_patches

        if not third:
            return _size(loaded, image, self.options.side or 518, self.options.max_patches)
        height, width = image.shape[:2]
        free = limit_patches(
            *input_size_by_long_side(height, width, self.options.side or 504, PATCH),
            self.options.max_patches,
        )
        return _fixed_or(loaded, free)

    def _camera(
        self, hints: Hints, image: UInt8Array, matrix: FloatArray | None, seen: tuple[int, ...]
    ) -> tuple[Intrinsics, tuple[str, ...]]:
        """Return the known camera, else the network's, else a default; and notes."""
        from physic_core.adapters.canonical_depth import known_camera

        known = known_camera(hints, image)
        if known is not None:
            return known, ()
        if matrix is not None:
            height, width = image.shape[:2]
            own = _camera_of(matrix, seen).resized(width, height)
            return own, (f"focal length {own.fx:.0f} px from Depth Anything 3",)
        return guessed_camera(self.options.default_fov, image)


def guessed_camera(fov_deg: float, image: UInt8Array) -> tuple[Intrinsics, tuple[str, ...]]:
    """Return intrinsics for a field of view in degrees along the image's long side, and a note for
    the user.
    """
    from physic_core.adapters.canonical_depth import focal_from_fov
    from physic_core.types import CameraTrust, Intrinsics

    height, width = image.shape[:2]
    source = f"default (field of view {fov_deg:g} degrees along the long side)"
    focal = focal_from_fov(fov_deg, max(height, width))
    camera = Intrinsics.from_focal(focal, width, height, source, CameraTrust.GUESSED)
    return camera, (f"focal length is a {source}",)


def preprocess(
    image: UInt8Array, rows: int, columns: int, *, normalised: bool = True
) -> FloatArray:
    """Resize an image (H, W, 3) to (1, 3, rows, columns): antialiased bicubic in 8 bits, then
    ImageNet's normalisation.

    Args:
        image: uint8 RGB.
        rows: of the input.
        columns: of the input.
        normalised: false leaves 0..255.
    """
    from physic_core.adapters.pictures import (
        IMAGENET_MEAN,
        IMAGENET_STD,
        normalized_nchw,
        resize_image,
    )

    small = resize_image(image, rows, columns, "bicubic-antialias")
    return (
        normalized_nchw(small, IMAGENET_MEAN, IMAGENET_STD)
        if normalised
        else normalized_nchw(small, scale=1.0)
    )


def _size(loaded: LoadedGraph, image: UInt8Array, side: int, most: int) -> tuple[int, int]:
    """Return the input size (rows, columns)."""
    from physic_onnx.depth_maps import input_size_least_scaling, limit_patches

    height, width = image.shape[:2]
    return _fixed_or(
        loaded, limit_patches(*input_size_least_scaling(height, width, side, PATCH), most)
    )


def _fixed_or(loaded: LoadedGraph, free: tuple[int, int]) -> tuple[int, int]:
    """Return the file's fixed input size, with free sides from a given size."""
    from .depth_maps import fixed_input_size

    rows, columns = fixed_input_size(loaded.input_shape("pixel_values"))
    return rows or free[0], columns or free[1]


def _ask(
    loaded: LoadedGraph, image: UInt8Array, rows: int, columns: int, pixels: Pixels, *extras: str
) -> tuple[list[FloatArray], tuple[str, ...]]:
    """Run the network: the map of depth or disparity (h, w), further outputs, and notes."""
    from .depth_maps import aspect_change_note, squeeze_map

    normalised = pixels == "imagenet" or (pixels == "auto" and not takes_raw_pixels(loaded))
    fed = preprocess(image, rows, columns, normalised=normalised)
    raw, *more = loaded.run_image("pixel_values", fed, "predicted_depth", *extras)
    values = squeeze_map(raw, "predicted_depth", loaded.network.name)
    fixed = loaded.ports.inputs["pixel_values"].shape[-2:] == (rows, columns)
    return [values, *more], aspect_change_note(
        image, rows, columns, loaded.network.name
    ) if fixed else ()


def _inverse_depth(depth: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return 1 / depth and where it is unknown; both (h, w)."""

    with np.errstate(invalid="ignore"):
        lost = ~(np.isfinite(depth) & (depth > 0))
    return 1 / np.where(lost, 1.0, depth), lost


def _open(loaded: LoadedGraph, third: bool) -> AffineAmbiguity:
    """Return the ambiguity of the output.

    Networks of several views estimate a camera, so that no shift is left.
    """
    if not third:
        return "inverse_scale_shift"
    views = (
        loaded.signature == VIEWS
        or loaded.has_output("intrinsics")
        or loaded.has_output("depth_conf")
    )
    return "scale" if views else "scale_shift"


def _camera_of(matrix: FloatArray, seen: tuple[int, ...]) -> Intrinsics:
    """Convert a camera matrix (..., 3, 3) that counts from pixel edges."""
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


def has_sigmoid(path: Path) -> bool:
    """Return whether an ONNX file contains a sigmoid node, by searching its bytes for the node
    type.
    """
    import mmap
    import re

    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return re.search(rb"\x22\x07Sigmoid|\x22\x0eQLinearSigmoid", data) is not None


def takes_raw_pixels(loaded: LoadedGraph) -> bool:
    """Return whether a file takes pixels from 0 to 255 and normalises them itself.

    Exports that do so name their input 'image' and its sides 'H' and 'W', and take one photo.
    """
    port = loaded.ports.inputs["pixel_values"]
    return port.name == "image" and port.shape == (1, 3, "H", "W")


def base_name(weights: str) -> str:
    """Return the last component of a path, or the full name of a weight set."""
    from pathlib import PurePath

    return PurePath(weights).name


def is_version_3_name(names: str) -> bool:
    """Return whether a file name belongs to Depth Anything 3."""
    return any(
        word in names.lower()
        for word in ("anything-3", "anything_3", "anything-v3", "anything_v3", "da3")
    )
