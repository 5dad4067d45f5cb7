"""Remove people from a photo with LaMa in any of its three published formats.

With a fixed input size, a smaller crop gives a sharper fill. Measured with MI-GAN on ten pairs of
holes in five photos, against the full photo squashed to 512 px: detail 0.40 of the true image's in
place of 0.28 with crops twice as wide as their hole (0.50 at 1.5, 0.28 at 3), at the same error
(15.2 dB).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import Inpainter, Options

from .one_graph import GraphSignature, LoadedGraph, OnnxBackend, OnnxBackendOptions, PortSpec
from .sessions import open_network

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, UInt8Array

    from .sessions import Network

INPUTS = (
    PortSpec("image", shape=(None, 3, None, None)),
    PortSpec("mask", shape=(None, 1, None, None)),
)
OUTPUTS = (PortSpec("output", ("result",), shape=(None, 3, None, None)),)

MULTIPLE = 8
"""Height and width of LaMa's input are multiples of this, px."""
_RIM = 0.004  # of the long side, by which the hole of the network is wider than the filled one
_CONTEXT = 2.0  # sides of a hole: side of the crop around it, for files of a fixed size
_LONGEST_PX = 1536  # long side of the photo, for files of any size
MOST_CROPS = 8

NEAR = 1.3
"""Holes share a crop if it is at most this many times as wide as the larger of their own crops."""


class LamaOptions(OnnxBackendOptions):
    """Settings of Lama."""

    weights: str = Field(
        "lama-carve",
        description="a name of `physic weights list`, or the path of a .onnx or a TorchScript .pt "
        "file",
    )


class Lama(OnnxBackend, Inpainter):
    """LaMa inpainter: takes RGB from 0 to 1, and a mask that is 1 in the hole.

    ONNX files of a fixed size (512 px) fill one crop a hole; files of any size, as TorchScript's,
    see the whole photo. It fills only the mask: shadows and mirror images of removed people stay.
    """

    written_for = 1
    Options: ClassVar[type[Options]] = LamaOptions
    options: LamaOptions
    signatures: ClassVar = {"LaMa": GraphSignature(INPUTS, OUTPUTS)}

    def build(self, device: str) -> Any:
        """Open the ONNX or TorchScript file of LaMa: a matched graph, or a function of image and
        mask.
        """
        path = self.graph_file()
        if path.suffix in (".pt", ".pth", ".ts"):
            return _open_torchscript(path, device)
        return self.match(open_network(path, self.options, device))

    def match(self, network: Network) -> LoadedGraph:
        """Match an open network, whose pictures must be squares or of any size."""
        loaded = super().match(network)
        side = loaded.inputs["image"].shape[2:]
        fixed = [n for n in side if isinstance(n, int)]
        if len(fixed) == 1 or len(set(fixed)) == 2:
            raise BackendError(
                f"{network.name} takes pictures of {side} px: a square or any size is expected"
            )
        return loaded

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); pixels outside the mask stay
        identical.

        Raises:
            InputError: the image is not a valid photo.
            BackendError: the mask has another size or covers the whole image, or load() was not
                called.
        """
        from physic_networks.pictures import inpaint_masked

        network = self.network
        side = network.inputs["image"].shape[2] if isinstance(network, LoadedGraph) else None
        if not isinstance(side, int):
            return inpaint_masked(image, mask, _RIM, self._fill)

        def in_crops(image: UInt8Array, hole: BoolArray) -> UInt8Array:
            return inpaint_in_crops(image, hole, partial(self._fill, square=side), side)

        return inpaint_masked(image, mask, _RIM, in_crops)

    def _ask(self, image: FloatArray, mask: FloatArray) -> FloatArray:
        """Run the ONNX or TorchScript file."""
        network = self.network
        if not isinstance(network, LoadedGraph):
            filled: FloatArray = network(image, mask)
            return filled
        (output,) = network.run({"image": image, "mask": mask}, ["output"])
        return output

    def _fill(self, image: UInt8Array, hole: BoolArray, square: int | None = None) -> UInt8Array:
        """Fill a hole: resize, pad by reflection, run the network, and resize back.

        Args:
            image: the photo, or a crop of it.
            hole: of the same size.
            square: side of the network's square input; None for the photo's own size, or
                ``_LONGEST_PX``.
        """
        from physic_networks.pictures import normalized_nchw, resize_image

        height, width = hole.shape
        long = min(_LONGEST_PX, max(height, width)) if square is None else square
        scale = long / max(height, width)
        inner = (max(1, round(height * scale)), max(1, round(width * scale)))
        padded = (
            (square, square)
            if square is not None
            else tuple(-(-n // MULTIPLE) * MULTIPLE for n in inner)
        )
        margins = [(0, total - n) for total, n in zip(padded, inner, strict=True)]
        small = resize_image(image, *inner, "area" if scale < 1 else "bicubic")
        # A pixel that is partly hole counts as hole, since its colour is partly that of the removed
        # person.
        covered = (
            resize_image(hole.astype(np.float32), *inner, "area" if scale < 1 else "bilinear") > 0
        )
        frame = normalized_nchw(np.pad(small, [*margins, (0, 0)], mode="symmetric"))
        covered = np.pad(covered, margins, mode="symmetric")
        known = ~covered
        answer = self._ask(frame, covered.astype(np.float32)[None, None])[0].transpose(1, 2, 0)
        colours = answer * _factor_to_grey_levels(answer[known], frame[0].transpose(1, 2, 0)[known])
        shown = colours[: inner[0], : inner[1]].astype(np.float32)
        back = resize_image(shown, height, width, "bicubic" if scale < 1 else "area")
        return np.asarray(back.round().clip(0, 255), np.uint8)


def _factor_to_grey_levels(answer: FloatArray, shown: FloatArray) -> float:
    """Return 255 for outputs from 0 to 1 and 1 for grey levels, by comparing known pixels with the
    input.

    Published files differ only in this. LaMa copies the known pixels to its output, so they show
    the range.
    """

    if not len(answer):
        return 1.0 if float(np.max(answer, initial=0.0)) > 2 else 255.0
    ratio = float(np.abs(answer).mean()) / max(float(shown.mean()), 1e-3)
    return 1.0 if ratio > 16 else 255.0


def _open_torchscript(path: Path, device: str) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Open a TorchScript file and return a function that runs it."""
    import torch

    from physic_core.backends.devices import check_device
    from physic_networks.networks import open_torchscript

    check_device(device)
    module = open_torchscript(path, device)

    def run(image: FloatArray, mask: FloatArray) -> FloatArray:
        with torch.inference_mode():
            try:
                answer = module(
                    torch.from_numpy(image).to(device), torch.from_numpy(mask).to(device)
                )
            except RuntimeError as cause:
                raise BackendError(
                    f"{path.name} does not take an image (1, 3, H, W) and a mask (1, 1, H, W) as "
                    f"LaMa does: {cause}"
                ) from cause
        filled: FloatArray = answer.float().cpu().numpy()
        return filled

    return run


Box = tuple[int, int, int, int]
"""Box y0, y1, x0, x1 px."""


def inpaint_in_crops(
    image: UInt8Array,
    hole: BoolArray,
    fill: Callable[[UInt8Array, BoolArray], UInt8Array],
    least: int,
) -> UInt8Array:
    """Fill every hole of an image with a network that runs on a crop around the hole.

    Filled pixels count as known pixels in later crops.

    Args:
        image: (H, W, 3).
        hole: (H, W), neither empty nor everything.
        fill: of a crop (h, w, 3) and its hole (h, w), which is neither empty nor everything.
        least: side that a crop has at least, px.
    """
    filled = image.copy()
    left = hole.copy()
    for own, (y0, y1, x0, x1) in hole_crops(hole, least):
        here = (slice(y0, y1), slice(x0, x1))
        answer = fill(np.ascontiguousarray(filled[here]), np.ascontiguousarray(left[here]))
        filled[here][own[here]] = answer[own[here]]
        left[own] = False
    return filled


def hole_crops(hole: BoolArray, least: int) -> list[tuple[BoolArray, Box]]:
    """Group the connected components of a hole, and return for each group its mask (H, W) and
    crop.
    """
    import cv2

    count, piece, stats, _ = cv2.connectedComponentsWithStats(hole.astype(np.uint8), connectivity=8)
    groups: list[list[int]] = [[i] for i in range(1, count)]
    boxes = [_box(stats[i]) for i in range(1, count)]
    while len(groups) > 1:
        pair = _pair_to_join(boxes, least, even_if_large=len(groups) > MOST_CROPS)
        if pair is None:
            break
        i, j = pair
        groups[i] += groups.pop(j)
        boxes[i] = _box_around(boxes[i], boxes.pop(j))
    order = np.argsort([-(b[1] - b[0]) * (b[3] - b[2]) for b in boxes], kind="stable")
    # A small hole beside a large one is filled first, so that it is context for the large one.
    return [(np.isin(piece, groups[i]), _crop(boxes[i], hole, least)) for i in order[::-1]]


def _pair_to_join(boxes: list[Box], least: int, *, even_if_large: bool) -> tuple[int, int] | None:
    """Return the two boxes whose common crop is relatively smallest, if small enough or if
    ``even_if_large``.
    """

    def growth(pair: tuple[int, int]) -> float:
        one, two = (boxes[i] for i in pair)
        return _side(_box_around(one, two), least) / max(_side(one, least), _side(two, least))

    best = min(itertools.combinations(range(len(boxes)), 2), key=growth)
    return best if even_if_large or growth(best) <= NEAR else None


def _side(box: Box, least: int) -> float:
    """Return the side of a box's crop."""
    return max(float(least), _CONTEXT * max(box[1] - box[0], box[3] - box[2]))


def _crop(box: Box, hole: BoolArray, least: int) -> Box:
    """Return a square crop around a box, inside the photo; larger if less than 30 % of it is
    known.
    """
    height, width = hole.shape
    side = _side(box, least)
    while True:
        y0, y1 = _span((box[0] + box[1]) / 2, side, height)
        x0, x1 = _span((box[2] + box[3]) / 2, side, width)
        everything = y1 - y0 == height and x1 - x0 == width
        if everything or (~hole[y0:y1, x0:x1]).mean() >= 0.3:
            return y0, y1, x0, x1
        side *= 1.5


def _span(middle: float, side: float, length: int) -> tuple[int, int]:
    """Return start and end of an interval of a given length inside the image."""
    whole = min(length, round(side))
    start = int(np.clip(round(middle - whole / 2), 0, length - whole))
    return start, start + whole


def _box(stats: NDArray[np.int32]) -> Box:
    """Convert OpenCV's component statistics to a box."""
    x, y, w, h = (int(v) for v in stats[:4])
    return y, y + h, x, x + w


def _box_around(a: Box, b: Box) -> Box:
    """Return the smallest box around two boxes."""
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])
