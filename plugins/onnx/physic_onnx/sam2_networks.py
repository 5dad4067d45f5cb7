"""Run the two networks of SAM 2 as samexporter writes them: encode a photo once, then predict masks
from boxes and points.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_networks.pictures import (
    IMAGENET_MEAN,
    IMAGENET_STD,
    normalized_nchw,
    resize_image,
)

from .sessions import OnnxOptions, open_network

if TYPE_CHECKING:
    from physic_core.types import AnyArray, FloatArray, UInt8Array

    from .sessions import Network

ENCODER = "sam2_hiera_tiny_encoder.with_runtime_opt.ort"
DECODER = "sam2_hiera_tiny_decoder_pr1.onnx"

_FEATURES = ("high_res_feats_0", "high_res_feats_1", "image_embed")
_ANSWER = ("masks", "iou_predictions")
_SIDE = 1024  # px, of the square that the encoder sees
_GRID = 256  # side of the masks that the decoder may be given

# Labels of points.
INSIDE = 1
OUTSIDE = 0
FIRST_CORNER = 2
LAST_CORNER = 3

BOXES_PER_CALL = 8
"""Boxes in one run of the decoder."""


@dataclass(frozen=True)
class EncodedImage:
    """Output of SAM 2's image encoder for one photo.

    Attributes:
        features: three maps by the names that the decoder takes.
        size: H and W of the photo, px.
    """

    features: dict[str, AnyArray]
    size: tuple[int, int]

    def to_input_pixels(self, points: FloatArray) -> FloatArray:
        """Convert photo pixels (..., 2) to pixels of the network input.

        Integers are pixel centres in both images.
        """
        height, width = self.size
        scale = _SIDE / np.array([width, height], np.float64)
        return (np.asarray(points, np.float64) + 0.5) * scale - 0.5


class Sam2Networks:
    """Loaded encoder and decoder networks of SAM 2."""

    def __init__(self, encoder: Network, decoder: Network) -> None:
        self._encoder = encoder
        self._decoder = decoder

    def encode(self, image: UInt8Array) -> EncodedImage:
        """Encode a photo (H, W, 3), RGB."""
        square = resize_image(image, _SIDE, _SIDE, "bilinear-antialias")
        frame = normalized_nchw(square, IMAGENET_MEAN, IMAGENET_STD)
        features = self._encoder.run({"image": frame}, _FEATURES)
        size = (image.shape[0], image.shape[1])
        return EncodedImage(dict(zip(_FEATURES, features, strict=True)), size)

    def masks_from_boxes(
        self, photo: EncodedImage, boxes: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Predict three masks for each of N boxes (N, 4): x0 y0 x1 y1 px, end exclusive; N > 0.

        Returns:
            (N, 3, h, w) logits of the photo resized to a square, above 0 inside, and (N, 3) quality
            predicted by the network.
        """
        corners = _corners(photo, boxes)
        starts = range(0, len(corners), BOXES_PER_CALL)
        answers = [self._run_decoder(photo, corners[i : i + BOXES_PER_CALL]) for i in starts]
        logits, fits = zip(*answers, strict=True)
        return np.concatenate(logits), np.concatenate(fits)

    def masks_from_points(
        self, photo: EncodedImage, inside: FloatArray, outside: FloatArray, box: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Predict three masks of the object in a box (4,) that contains ``inside`` (P, 2) and not
        ``outside`` (Q, 2).

        Returns:
            (3, h, w) logits of the photo resized to a square, and (3,) predicted quality.
        """
        points = photo.to_input_pixels(np.concatenate([inside, outside]))
        labels = [INSIDE] * len(inside) + [OUTSIDE] * len(outside)
        prompt = np.concatenate([_corners(photo, box), points[None]], axis=1)
        logits, fits = self._run_decoder(photo, prompt, labels)
        return logits[0], fits[0]

    def _run_decoder(
        self, photo: EncodedImage, prompt: FloatArray, labels: list[int] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Run the decoder on N prompts (N, 2 + P, 2): corners of a box, and P labelled points."""
        kinds = [FIRST_CORNER, LAST_CORNER, *(labels or [])]
        feed = {
            "point_coords": prompt.astype(np.float32),
            "point_labels": np.tile(np.array(kinds, np.float32), (len(prompt), 1)),
            "mask_input": np.zeros((len(prompt), 1, _GRID, _GRID), np.float32),
            "has_mask_input": np.zeros(1, np.float32),
        }
        logits, fits = self._decoder.run(feed | photo.features, _ANSWER)
        return logits, fits


def _corners(photo: EncodedImage, boxes: FloatArray) -> FloatArray:
    """Convert boxes (N, 4) in photo px to corner points (N, 2, 2) in px of the square."""
    # The network was trained with the first and the last pixel of the object.
    return photo.to_input_pixels(np.asarray(boxes, np.float64).reshape(-1, 2, 2) - [[0, 0], [1, 1]])


def open_sam2(folder: Path, options: OnnxOptions, device: str) -> Sam2Networks:
    """Open the encoder and the decoder in a folder.

    Raises:
        BackendError: a file is broken.
        DeviceError: the device is not there.
    """
    encoder, decoder = (open_network(folder / name, options, device) for name in (ENCODER, DECODER))
    return Sam2Networks(encoder, decoder)
