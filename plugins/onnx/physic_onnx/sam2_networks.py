"""Run the two networks of SAM 2: encode a photo once, then predict masks from boxes and points.

Two exports are published. They contain the same networks, with different names, types and ranks,
and encode a box as a box or as two labelled points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BackendError

from .one_graph import GraphSignature, PortSpec, match_signature

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray, UInt8Array

    from .sessions import Network, OnnxOptions

_FEATURES = {
    "transformers.js": ("image_embeddings.0", "image_embeddings.1", "image_embeddings.2"),
    "samexporter": ("high_res_feats_0", "high_res_feats_1", "image_embed"),
}
"""Outputs of the encoder by the exporting tool, sorted from fine to coarse."""
_MAPS = {
    tool: tuple(
        PortSpec(name, shape=(None, channels, None, None))
        for name, channels in zip(names, (32, 64, 256), strict=True)
    )
    for tool, names in _FEATURES.items()
}
_PICTURES = {"transformers.js": "pixel_values", "samexporter": "image"}
ENCODERS: Mapping[str, GraphSignature] = {
    tool: GraphSignature((PortSpec(name, shape=(None, 3, None, None)),), _MAPS[tool])
    for tool, name in _PICTURES.items()
}
"""Signatures of the encoder by the exporting tool."""

DECODERS: Mapping[str, GraphSignature] = {
    "transformers.js": GraphSignature(
        (
            PortSpec("input_points", shape=(None, None, None, 2)),
            PortSpec("input_labels", dtype="int64", shape=(None, None, None)),
            PortSpec("input_boxes", shape=(None, None, 4)),
            *_MAPS["transformers.js"],
        ),
        (
            PortSpec("pred_masks", shape=(None, None, None, None, None)),
            PortSpec("iou_scores", shape=(None, None, None)),
        ),
    ),
    "samexporter": GraphSignature(
        (
            *_MAPS["samexporter"],
            PortSpec("point_coords", shape=(None, None, 2)),
            PortSpec("point_labels", shape=(None, None)),
            PortSpec("mask_input", shape=(None, 1, None, None)),
            PortSpec("has_mask_input", shape=(None,)),
        ),
        (
            PortSpec("masks", shape=(None, None, None, None)),
            PortSpec("iou_predictions", shape=(None, None)),
        ),
    ),
}
"""Signatures of the decoder by the exporting tool. The outputs are masks and their quality."""

INSIDE = 1
OUTSIDE = 0
NOTHING = -1
FIRST_CORNER = 2
LAST_CORNER = 3
"""Labels of points."""

SAM3_SIDE = 1008
"""Input side of SAM 3's tracker, which has the ports of SAM 2 and takes pixels from -1 to 1."""

BOXES_PER_CALL = 8
"""Boxes in one run of the decoder."""


@dataclass(frozen=True)
class EncodedImage:
    """Output of SAM 2's image encoder for one photo.

    Attributes:
        features: three maps, finest first.
        size: H and W of the photo, px.
        side: of the square that the photo was squashed to, px.
    """

    features: tuple[NDArray[Any], ...]
    size: tuple[int, int]
    side: int

    def to_input_pixels(self, points: FloatArray) -> FloatArray:
        """Convert photo pixels (..., 2) to pixels of the network input.

        Integers are pixel centres in both images.
        """

        height, width = self.size
        scale = self.side / np.array([width, height], np.float64)
        frame: FloatArray = (np.asarray(points, np.float64) + 0.5) * scale - 0.5
        return frame


class Sam2Networks:
    """Loaded encoder and decoder networks of SAM 2.

    Raises:
        BackendError: one does not match its signature, or they are of different exports.
    """

    def __init__(self, encoder: Network, decoder: Network) -> None:
        self._encoder = match_signature(encoder, ENCODERS)
        self._decoder = match_signature(decoder, DECODERS)
        if self._decoder.signature != self._encoder.signature:
            raise BackendError(
                f"the encoder {encoder.name} comes from {self._encoder.signature} and the decoder "
                f"{decoder.name} from {self._decoder.signature}: take both from one export"
            )
        ((self._picture, port),) = self._encoder.inputs.items()
        self._side = port.shape[2] if isinstance(port.shape[2], int) else 1024
        self._has_boxes = "input_boxes" in self._decoder.inputs

    def encode(self, image: UInt8Array) -> EncodedImage:
        """Encode a photo (H, W, 3), RGB."""
        from physic_networks.pictures import (
            IMAGENET_MEAN,
            IMAGENET_STD,
            normalized_nchw,
            resize_image,
        )

        half = (0.5, 0.5, 0.5)
        mean, std = (half, half) if self._side == SAM3_SIDE else (IMAGENET_MEAN, IMAGENET_STD)
        frame = normalized_nchw(
            resize_image(image, self._side, self._side, "bilinear-antialias"), mean, std
        )
        features = self._encoder.run({self._picture: frame}, self._encoder.outputs)
        return EncodedImage(tuple(features), (image.shape[0], image.shape[1]), self._side)

    def masks_from_boxes(
        self, photo: EncodedImage, boxes: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Predict three masks for each of N boxes (N, 4): x0 y0 x1 y1 px, end exclusive.

        Returns:
            (N, 3, h, w) logits of the photo resized to a square, above 0 inside, and (N, 3) quality
            predicted by the network.
        """

        corners = self._corners(photo, boxes)
        at_once = self._boxes_per_call()
        answers = [
            self._ask(photo, corners[i : i + at_once]) for i in range(0, len(corners), at_once)
        ]
        logits, fits = zip(*answers, strict=True)
        return np.concatenate(logits), np.concatenate(fits)

    def masks_from_points(
        self, photo: EncodedImage, inside: FloatArray, outside: FloatArray, box: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Predict three masks of the object in a box (4,) that contains ``inside`` (P, 2) and not
        ``outside`` (Q, 2).

        Points without a box are not supported. The export that accepts them joins them with an
        empty array of boxes, and onnxruntime then leaves three tokens uninitialised.

        Returns:
            (3, h, w) logits of the photo resized to a square, and (3,) predicted quality.
        """

        points = photo.to_input_pixels(np.concatenate([inside, outside]))
        labels = np.array([INSIDE] * len(inside) + [OUTSIDE] * len(outside))
        logits, fits = self._ask(photo, self._corners(photo, box[None]), (points, labels))
        return logits[0], fits[0]

    def _corners(self, photo: EncodedImage, boxes: FloatArray) -> FloatArray:
        """Convert boxes (N, 4) in photo px to corner points (N, 2, 2) in px of the square."""

        # The network was trained with the first and the last pixel of the object.
        return photo.to_input_pixels(
            np.asarray(boxes, np.float64).reshape(-1, 2, 2) - [[0, 0], [1, 1]]
        )

    def _ask(
        self,
        photo: EncodedImage,
        corners: FloatArray,
        points: tuple[FloatArray, NDArray[Any]] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Run the decoder on boxes and optional points: logits and predicted fits."""
        prompt = self._with_boxes if self._has_boxes else self._with_corner_points
        feed = prompt(corners, points)
        feed.update(zip(self._encoder.outputs, photo.features, strict=True))
        logits, fits = self._decoder.run(feed, self._decoder.outputs)
        return (logits[0], fits[0]) if self._has_boxes else (logits, fits)

    def _with_boxes(
        self, corners: FloatArray, points: tuple[FloatArray, NDArray[Any]] | None
    ) -> dict[str, NDArray[Any]]:
        """Build the decoder input of transformers.js: boxes, and points with labels."""
        if points is not None:
            prompt = points[0][None, None]
            labels = points[1][None, None]
        else:
            # Not every provider takes empty arrays; a padding point has nearly the same effect.
            none = 0 if self._decoder.network.provider in ("CPU", "CUDA") else 1
            prompt = np.zeros((1, len(corners), none, 2))
            labels = np.full((1, len(corners), none), NOTHING)
        return {
            "input_points": prompt.astype(np.float32),
            "input_labels": labels.astype(np.int64),
            "input_boxes": corners.reshape(1, -1, 4).astype(np.float32),
        }

    def _with_corner_points(
        self, corners: FloatArray, points: tuple[FloatArray, NDArray[Any]] | None
    ) -> dict[str, NDArray[Any]]:
        """Build the decoder input of samexporter: corner points and points with labels."""
        prompt = corners
        labels = np.tile([FIRST_CORNER, LAST_CORNER], (len(corners), 1))
        if points is not None:
            prompt = np.concatenate([prompt, points[0][None]], axis=1)
            labels = np.concatenate([labels, points[1][None]], axis=1)
        side = self._decoder.inputs["mask_input"].shape[2]
        grid = side if isinstance(side, int) else self._side // 4
        return {
            "point_coords": prompt.astype(np.float32),
            "point_labels": labels.astype(np.float32),
            "mask_input": np.zeros((len(prompt), 1, grid, grid), np.float32),
            "has_mask_input": np.zeros(1, np.float32),
        }

    def _boxes_per_call(self) -> int:
        """Return the number of boxes in one run, which a file may fix to one."""
        name, axis = ("input_boxes", 1) if self._has_boxes else ("point_coords", 0)
        fixed = self._decoder.inputs[name].shape[axis]
        return fixed if isinstance(fixed, int) and fixed > 0 else BOXES_PER_CALL


def open_sam2(folder: Path, options: OnnxOptions, device: str, variant: str = "") -> Sam2Networks:
    """Open the encoder and the decoder in a folder.

    Raises:
        BackendError: a file is missing, or does not match its signature.
        DeviceError: the device is not there.
    """
    from .sessions import open_network

    encoder, decoder = find_sam2_files(folder, variant)
    return Sam2Networks(
        open_network(encoder, options, device), open_network(decoder, options, device)
    )


def find_sam2_files(folder: Path, variant: str = "") -> tuple[Path, Path]:
    """Find the encoder file and the decoder file in a folder or below it.

    Args:
        folder: holds them, under names with the words "encoder" and "decoder".
        variant: such as "fp16", of the encoder; empty for the plain one.

    Raises:
        BackendError: there are none.
    """
    files = sorted(p for p in folder.rglob("*") if p.suffix in (".onnx", ".ort") and p.is_file())
    # The decoder of one export is called prompt_encoder_mask_decoder.
    decoders = [p for p in files if "decoder" in p.name]
    encoders = [p for p in files if "encoder" in p.name and p not in decoders]
    wanted = [p for p in encoders if not variant or p.stem.endswith(f"_{variant}")]
    if not wanted or not decoders:
        suffix = f" _{variant}" if variant else ""
        lack = "a decoder" if wanted else f"an encoder{suffix}"
        there = ", ".join(p.name for p in files) or "none"
        raise BackendError(
            f"SAM 2 is two files, an encoder and a decoder, and {folder} has not {lack}; its "
            f"files of networks: {there}"
        )
    # A variant has a longer name than the plain file.
    return min(wanted, key=lambda p: len(p.name)), min(decoders, key=lambda p: len(p.name))
