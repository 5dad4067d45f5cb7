"""Predict masks from points and boxes with MobileSAM."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import Float32Array, FloatArray, UInt8Array
    from physic_networks.onnx_sessions import OnnxSession


FRAME_SIZE = 1024
MASK_SIZE = 256
"""Side of the predicted masks: one cell is 4 x 4 px of the 1024 px frame."""


@dataclass(frozen=True)
class ImageEmbedding:
    """Output of MobileSAM's image encoder for one photo.

    Attributes:
        features: (1, 256, 64, 64).
        height: of the photo, px.
        width: of the photo, px.
        scale: frame px a photo px.
    """

    features: FloatArray
    height: int
    width: int
    scale: float

    def to_input_pixels(self, points: FloatArray) -> FloatArray:
        """Convert photo pixels (..., 2) to pixels of the network input.

        Integers are pixel centres in both images.
        """
        return (points + 0.5) * self.scale - 0.5

    @property
    def grid_shape(self) -> tuple[int, int]:
        """Rows and columns of the low-resolution mask that lie on the photo."""
        cell = FRAME_SIZE / MASK_SIZE
        return math.ceil(self.height * self.scale / cell), math.ceil(self.width * self.scale / cell)

    @property
    def cell(self) -> float:
        """Side of one pixel of the low-resolution mask, in photo px."""
        return FRAME_SIZE / MASK_SIZE / self.scale

    def grid_axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the centres of the low-resolution mask's columns and rows, in photo px."""
        rows, columns = self.grid_shape
        x, y = ((np.arange(count) + 0.5) * self.cell - 0.5 for count in (columns, rows))
        return x, y

    def to_photo(self, logits: FloatArray) -> Float32Array:
        """Resample a low-resolution mask (rows, columns) to photo pixels (H, W), bilinear."""
        import cv2

        half = 0.5 / self.cell - 0.5
        matrix = np.array([[1.0 / self.cell, 0.0, half], [0.0, 1.0 / self.cell, half]])
        moved: Float32Array = cv2.warpAffine(
            np.ascontiguousarray(logits, np.float32), matrix, (self.width, self.height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return moved


@dataclass(frozen=True)
class MaskProposals:
    """Four mask proposals for one prompt.

    Attributes:
        logits: (4, rows, columns), above 0 inside; the first is for prompts without ambiguity, the
            others are whole, part and part of a part.
        iou: (4,) intersection over union of each mask with the object, as predicted.
        raw: (4, 256, 256), input of a further prediction.
    """

    logits: FloatArray
    iou: FloatArray
    raw: FloatArray


def embed_image(session: OnnxSession, image: UInt8Array) -> ImageEmbedding:
    """Encode a photo (H, W, 3) with the ``mobilesam_encoder``."""
    import cv2

    h, w = image.shape[:2]
    scale = FRAME_SIZE / max(h, w)
    nh = max(1, round(h * scale))
    nw = max(1, round(w * scale))
    small = cv2.resize(
        image, (nw, nh), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    )
    inputs = {"image": small.transpose(2, 0, 1)[None].astype(np.float32)}
    (features,) = session.run(None, inputs, keep=True)
    return ImageEmbedding(features, h, w, scale)


def predict_masks(
    session: OnnxSession,
    embedding: ImageEmbedding,
    inside: FloatArray,
    outside: FloatArray,
    box: FloatArray | None = None,
    mask: FloatArray | None = None,
) -> MaskProposals:
    """Predict masks of the object that contains the points ``inside`` and none of the points
    ``outside``.

    Args:
        session: of ``mobilesam_decoder``.
        embedding: of the photo.
        inside: (P, 2) photo px on the object.
        outside: (Q, 2) photo px beside it.
        box: (4,) x0 y0 x1 y1 photo px around it.
        mask: (256, 256) logits, one of ``raw`` of an earlier prediction.
    """
    points = [
        embedding.to_input_pixels(np.asarray(p, float).reshape(-1, 2)) for p in (inside, outside)
    ]
    labels = [np.ones(len(points[0])), np.zeros(len(points[1]))]
    if box is None:
        # The decoder wants a padding point where there is no box.
        points.append(np.zeros((1, 2)))
        labels.append(np.full(1, -1.0))
    else:
        points.append(embedding.to_input_pixels(np.asarray(box, float).reshape(2, 2)))
        labels.append(np.array([2.0, 3.0]))
    raw, iou = session.run(
        ["low_res_masks", "iou"],
        {
            "image_embeddings": embedding.features,
            "point_coords": np.concatenate(points)[None].astype(np.float32),
            "point_labels": np.concatenate(labels)[None].astype(np.float32),
            "mask_input": np.zeros((1, 1, MASK_SIZE, MASK_SIZE), np.float32)
            if mask is None
            else mask[None, None],
            "has_mask_input": np.array([0 if mask is None else 1], np.float32),
        },
    )
    rows, columns = embedding.grid_shape
    return MaskProposals(raw[0, :, :rows, :columns], iou[0], raw[0])
