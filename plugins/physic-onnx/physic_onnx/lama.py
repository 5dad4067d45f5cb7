"""Remove people from a photo with LaMa in any of its three published formats."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import Inpainter, Options

from .contract import GraphSignature, PortSpec
from .one_graph import LoadedGraph, OnnxBackend, OnnxBackendOptions
from .sessions import open_network

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from physic_core.types import BoolArray, FloatArray, UInt8Array

    from .sessions import Network

INPUTS = (PortSpec("image", shape=(None, 3, None, None)), PortSpec("mask", shape=(None, 1, None, None)))
OUTPUTS = (PortSpec("output", ("result",), shape=(None, 3, None, None)),)

MULTIPLE = 8
"""Height and width of LaMa's input are multiples of this, px."""


class LamaOptions(OnnxBackendOptions):
    """Settings of Lama."""

    weights: str = Field(
        "lama-carve", description="a name of `physic weights list`, or the path of a .onnx or a TorchScript .pt file"
    )
    rim: float = Field(
        0.004,
        ge=0,
        le=0.1,
        description="share of the long side by which the network's hole is wider than what is filled; 0.004-0.012",
    )
    context: float = Field(
        2.0,
        gt=1,
        le=8,
        description="side of the crop that files of a fixed size are shown about a hole, in sides of the hole; 1.5-3",
    )
    longest_px: int = Field(
        1536,
        ge=64,
        le=100_000,
        description="long side at which files of any size see the photo; more is sharper, and slow",
    )


class Lama(OnnxBackend, Inpainter):
    """LaMa inpainter: takes RGB from 0 to 1, and a mask that is 1 in the hole.

    ONNX files of a fixed size (512 px) fill one crop a hole; files of any size, as TorchScript's, see the whole photo.
    It fills what the mask covers: shadows and mirror images of who is removed stay.
    """

    written_for = 1
    Options: ClassVar[type[Options]] = LamaOptions
    options: LamaOptions
    signatures: ClassVar = {"LaMa": GraphSignature(INPUTS, OUTPUTS)}

    def build(self, device: str) -> Any:
        """Open the ONNX or TorchScript file of LaMa: a matched graph, or a function of image and mask."""
        path = self.graph_file()
        if path.suffix in (".pt", ".pth", ".ts"):
            return _open_torchscript(path, device)
        return self.match(open_network(path, self.options, device))

    def match(self, network: Network) -> LoadedGraph:
        """Match an open network, whose pictures must be squares or of any size."""
        loaded = super().match(network)
        side = loaded.input_shape("image")[2:]
        fixed = [n for n in side if isinstance(n, int)]
        if len(fixed) == 1 or len(set(fixed)) == 2:
            raise BackendError(f"{network.name} takes pictures of {side} px: a square or any size is expected")
        return loaded

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); pixels outside the mask stay identical.

        Raises:
            InputError: the image is not a valid photo.
            BackendError: the mask has another size or leaves nothing to go by, or load() was not called.
        """
        from physic_core.adapters.pictures import inpaint_masked

        from .holes import inpaint_in_crops

        shape = self.network.input_shape("image") if isinstance(self.network, LoadedGraph) else ()
        side = shape[2] if shape and isinstance(shape[2], int) else None
        if side is None:
            return inpaint_masked(image, mask, self.options.rim, self._fill)

        def in_crops(image: UInt8Array, hole: BoolArray) -> UInt8Array:
            return inpaint_in_crops(image, hole, partial(self._fill, square=side), self.options.context, side)

        return inpaint_masked(image, mask, self.options.rim, in_crops)

    def _ask(self, image: FloatArray, mask: FloatArray) -> FloatArray:
        """Run the ONNX or TorchScript file."""
        network = self.network
        if not isinstance(network, LoadedGraph):
            filled: FloatArray = network(image, mask)
            return filled
        (output,) = network.ports.run(network.network, {"image": image, "mask": mask}, ["output"])
        return output

    def _fill(self, image: UInt8Array, hole: BoolArray, square: int | None = None) -> UInt8Array:
        """Fill a hole: resize, pad by reflection, run the network, and resize back.

        Args:
            image: the photo, or a crop of it.
            hole: of the same size.
            square: side of the network's square input; None for the photo's own size, or ``longest_px``.
        """
        from physic_core.adapters.pictures import normalized_nchw, resize_image

        height, width = hole.shape
        long = min(self.options.longest_px, max(height, width)) if square is None else square
        scale = long / max(height, width)
        inner = (max(1, round(height * scale)), max(1, round(width * scale)))
        padded = (square, square) if square is not None else tuple(-(-n // MULTIPLE) * MULTIPLE for n in inner)
        margins = [(0, total - n) for total, n in zip(padded, inner, strict=True)]
        small = resize_image(image, *inner, "area" if scale < 1 else "bicubic")
        # A pixel of which a part is hole is hole: its colour is partly that of who is removed.
        covered = resize_image(hole.astype(np.float32), *inner, "area" if scale < 1 else "bilinear") > 0
        frame = normalized_nchw(np.pad(small, [*margins, (0, 0)], mode="symmetric"))
        covered = np.pad(covered, margins, mode="symmetric")
        known = ~covered
        answer = self._ask(frame, covered.astype(np.float32)[None, None])[0].transpose(1, 2, 0)
        colours = answer * _to_grey_levels(answer[known], frame[0].transpose(1, 2, 0)[known])
        back = resize_image(colours[: inner[0], : inner[1]].astype(np.float32), height, width, _back(scale))
        return np.asarray(back.round().clip(0, 255), np.uint8)


def _back(scale: float) -> Any:
    """Return the interpolation for resizing back."""
    return "bicubic" if scale < 1 else "area"


def _to_grey_levels(answer: FloatArray, shown: FloatArray) -> float:
    """Return 255 for outputs from 0 to 1 and 1 for grey levels, by comparing known pixels with the input.

    The files are of one contract but for this. LaMa hands through what is known of the picture, which tells.
    """

    if not len(answer):
        return 1.0 if float(np.max(answer, initial=0.0)) > 2 else 255.0
    ratio = float(np.abs(answer).mean()) / max(float(shown.mean()), 1e-3)
    return 1.0 if ratio > 16 else 255.0


def _open_torchscript(path: Path, device: str) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Open a TorchScript file and return a function that runs it."""
    import warnings

    import torch

    from physic_core.adapters.devices import check_device

    check_device(device)
    where = torch.device(device)
    try:
        with warnings.catch_warnings():  # torch has newer formats, but the file is published in this one
            warnings.simplefilter("ignore", DeprecationWarning)
            module = torch.jit.load(str(path), map_location=where).eval()  # type: ignore[no-untyped-call]
    except RuntimeError as cause:
        raise BackendError(f"torch cannot open {path} as TorchScript: {cause}") from cause

    def run(image: FloatArray, mask: FloatArray) -> FloatArray:
        with torch.inference_mode():
            try:
                answer = module(torch.from_numpy(image).to(where), torch.from_numpy(mask).to(where))
            except RuntimeError as cause:
                raise BackendError(
                    f"{path.name} does not take an image (1, 3, H, W) and a mask (1, 1, H, W) as LaMa does: {cause}"
                ) from cause
        filled: FloatArray = answer.float().cpu().numpy()
        return filled

    return run
