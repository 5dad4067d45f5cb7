"""Estimate relative points with ONNX files of Depth Anything: V2 relative, V2 metric and 3.

V2 relative returns disparity, larger is nearer; V2 metric and 3 return depth. The files of V2 have
the same ports; only the metric network ends in a sigmoid. Files of 3 are known by their ports or
their name; some return a camera or the sky.
"""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import RelativePointmap

from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackend, OnnxBackendOptions, PortSpec

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import (
        AffineAmbiguity,
        BoolArray,
        FloatArray,
        Hints,
        Intrinsics,
        Pointmap,
        UInt8Array,
    )

    from .one_graph import LoadedGraph

_SIDE = 518  # px, of V2; a multiple of a patch of 14 px
_SIDE_3 = 504  # px, long side of 3
_MAX_PATCHES = 5000  # limits time and memory of long panoramas
_DEFAULT_FOV = 55.5  # degrees along the long side, where no camera is known
_SKY_SCORE = 0.3  # of 3; above it is sky
_SATURATED = 0.98  # of the largest depth that a metric network of V2 can predict
_LARGEST_M = {"indoor": 20.0, "hypersim": 20.0, "outdoor": 80.0, "vkitti": 80.0}
_NAMES_OF_3 = ("anything-3", "anything_3", "anything-v3", "anything_v3", "da3")

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


class DepthAnythingOptions(OnnxBackendOptions):
    """Settings of Depth Anything."""

    weights: str = Field("depth-anything-v2-small", description=WEIGHTS_HELP)
    answers: Literal["auto", "disparity", "depth"] = Field(
        "auto",
        description="what the file returns: 'auto' reads it from the file's ports, last layer and "
        "name",
    )


class DepthAnything(OnnxBackend, RelativePointmap):
    """Relative point map by Depth Anything V2 or 3, up to scale, or scale and shift."""

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = DepthAnythingOptions
    options: DepthAnythingOptions
    reads = ("intrinsics",)
    signatures: ClassVar = {
        VIEWS: GraphSignature((_ONE_VIEW,), (_DEPTH, *_EXTRAS)),
        PUBLISHED: GraphSignature((_PICTURE,), (_DEPTH, *_EXTRAS)),
        OTHER: GraphSignature((_PICTURE,), (_DEPTH,), by_position=True),
    }
    _sigmoid = False

    def build(self, device: str) -> LoadedGraph:
        """Open the file and see whether it is a metric one of V2."""
        loaded = super().build(device)
        self._sigmoid = has_sigmoid(self.graph_file())
        return loaded

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Predict the relative point map of an image (H, W, 3); points without depth are invalid.

        Raises:
            BackendError: the network is not loaded, or sees nothing.
        """
        from physic_core.types import Pointmap

        from .depth_maps import (
            aspect_change_note,
            clip_disparity,
            points_from_disparity,
            squeeze_map,
        )

        loaded = self.network
        file = loaded.network.name
        rows, columns = self._size(image)
        shape = loaded.inputs["pixel_values"].shape
        extras = [name for name in ("sky", "intrinsics") if name in loaded.outputs]
        fed = preprocess(image, rows, columns, normalised=not takes_raw_pixels(loaded))
        fed = fed.reshape((1,) * (len(shape) - 3) + fed.shape[1:])  # version 3 has an axis of views
        raw, *more = loaded.run({"pixel_values": fed}, ["predicted_depth", *extras])
        values = squeeze_map(raw, "predicted_depth", file)
        optional = dict(zip(extras, more, strict=True))
        unknown = self._ambiguity()
        gap, lost = (
            clip_disparity(values)
            if unknown == "inverse_scale_shift"
            else _inverse_depth(values, self._farthest())
        )
        if "sky" in optional:
            lost |= squeeze_map(optional["sky"], "sky", file, may_be_flat=True) >= _SKY_SCORE
        if lost.all():
            raise BackendError(f"{file} saw no structure in the photo: no pixel has a depth")
        camera, said = _camera(hints, image, optional.get("intrinsics"), values.shape)
        points, valid = points_from_disparity(np.where(lost, gap[~lost].min(), gap), lost, camera)
        fixed = shape[-2:] == (rows, columns)
        notes = aspect_change_note(image, rows, columns, file) if fixed else ()
        return Pointmap(points, valid, unknown, camera, (*said, *notes))

    def _names(self) -> str:
        """Return the names of the weights and of the file, in small letters."""
        return f"{PurePath(self.options.weights).name} {self.network.network.name}".lower()

    def _is_version_3(self) -> bool:
        """Return whether the file belongs to Depth Anything 3, by its ports or its name."""
        loaded = self.network
        return (
            loaded.signature == VIEWS
            or any(extra.name in loaded.outputs for extra in _EXTRAS)
            or any(word in self._names() for word in _NAMES_OF_3)
        )

    def _ambiguity(self) -> AffineAmbiguity:
        """Return the ambiguity of the output.

        Metric networks, and those of several views, which estimate a camera, leave no shift.
        """
        third = self._is_version_3()
        answers = self.options.answers
        if answers == "disparity" or (answers == "auto" and not third and not self._sigmoid):
            return "inverse_scale_shift"
        if not third:
            return "scale" if self._sigmoid else "scale_shift"
        loaded = self.network
        unshifted = (
            loaded.signature == VIEWS
            or not {"intrinsics", "depth_conf"}.isdisjoint(loaded.outputs)
            or "metric" in self._names()
        )
        return "scale" if unshifted else "scale_shift"

    def _farthest(self) -> float:
        """Return the largest reliable depth of a metric network of V2, m; else infinity."""
        names = self._names()
        known = (_SATURATED * most for word, most in _LARGEST_M.items() if word in names)
        return next(known, np.inf) if self._sigmoid else np.inf

    def _size(self, image: UInt8Array) -> tuple[int, int]:
        """Return the input size (rows, columns): the file's own where it fixes a side."""
        from .depth_maps import (
            input_size_by_long_side,
            input_size_least_scaling,
            limit_patches,
        )

        height, width = image.shape[:2]
        free = limit_patches(
            *(
                input_size_by_long_side(height, width, _SIDE_3)
                if self._is_version_3()
                else input_size_least_scaling(height, width, _SIDE)
            ),
            _MAX_PATCHES,
        )
        stated = self.network.inputs["pixel_values"].shape[-2:]
        rows, columns = (
            side if isinstance(side, int) else own for side, own in zip(stated, free, strict=True)
        )
        return rows, columns


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
    from physic_networks.pictures import (
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


def _inverse_depth(depth: FloatArray, farthest: float) -> tuple[FloatArray, BoolArray]:
    """Return 1 / depth and where it is unknown; both (h, w)."""
    with np.errstate(invalid="ignore"):
        lost = ~(np.isfinite(depth) & (depth > 0) & (depth <= farthest))
    return 1 / np.where(lost, 1.0, depth), lost


def _camera(
    hints: Hints, image: UInt8Array, matrix: FloatArray | None, seen: tuple[int, ...]
) -> tuple[Intrinsics, tuple[str, ...]]:
    """Return the known camera, else the network's (..., 3, 3), else a default; and notes.

    The network's counts from the edges of the pixels of its picture, whose size is ``seen``.
    """
    from physic_core.types import CameraTrust, Intrinsics
    from physic_networks.canonical_depth import focal_from_fov, known_camera

    known = known_camera(hints, image)
    if known is not None:
        return known, ()
    height, width = image.shape[:2]
    if matrix is not None:
        k = matrix.reshape(-1, 3, 3)[0].astype(float)
        own = Intrinsics(
            k[0, 0], k[1, 1], k[0, 2] - 0.5, k[1, 2] - 0.5, seen[1], seen[0], "Depth Anything 3"
        ).resized(width, height)
        return own, (f"focal length {own.fx:.0f} px from Depth Anything 3",)
    source = f"default (field of view {_DEFAULT_FOV:g} degrees along the long side)"
    focal = focal_from_fov(_DEFAULT_FOV, max(height, width))
    guess = Intrinsics.from_focal(focal, width, height, source, CameraTrust.GUESSED)
    return guess, (f"focal length is a {source}",)


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
    port = loaded.inputs["pixel_values"]
    return port.name == "image" and port.shape == (1, 3, "H", "W")
