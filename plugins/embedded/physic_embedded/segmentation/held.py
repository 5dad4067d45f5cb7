"""Segment what people hold in their hands: boxes of YOLOX beside a hand prompt MobileSAM."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.masks import dilate
from physic_embedded.networks.mobile_sam import predict_masks

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, People
    from physic_embedded.networks.mobile_sam import ImageEmbedding
    from physic_networks.onnx_sessions import OnnxSession

HANDS = [[15, 17, 19], [16, 18, 20]]
"""Landmarks of wrist, little finger and index finger, left and right."""
LEAST_CONFIDENCE = 0.5
"""Least mean confidence of the landmarks of a hand."""
REACH = 0.8
"""Largest distance of a held thing's box from the middle of a hand, in lengths of the trunk: chosen
with the two limits below on 82 labelled photos, on which all 11 masks are right.
"""
MIN_IOU = 0.85
MIN_STABILITY = 0.9
"""A mask has a clear border if the network predicts at least this overlap with the object, and if
the masks of logits above 1 and above -1 overlap as much.
"""


def segment_held(
    decoder: OnnxSession, embedding: ImageEmbedding, boxes: FloatArray, people: People
) -> BoolArray | None:
    """Return the pixels (N, 2, H, W) of what each person's hands hold; None if no such thing is
    found.

    Args:
        decoder: session of ``mobilesam_decoder``.
        embedding: of the photo.
        boxes: (M, 4) x0 y0 x1 y1 px of things that may be in hands, best first.
        people: N people with keypoints "blazepose33".
    """
    keypoints = people.keypoints
    assert keypoints is not None
    points = keypoints.points
    hands = points[:, HANDS].mean(2)
    trunk = np.linalg.norm(points[:, [11, 12]].mean(1) - points[:, [23, 24]].mean(1), axis=-1)
    seen = keypoints.confidence[:, HANDS].mean(2) >= LEAST_CONFIDENCE
    free = ~people.masks.any(0)
    held = None
    for box in boxes:
        away = np.linalg.norm(hands - np.clip(hands, box[:2], box[2:]), axis=-1)
        beside = np.argwhere(seen & (away <= REACH * trunk[:, None]))
        if not len(beside):
            continue
        thing = free & _clear_mask(decoder, embedding, box)
        spots = np.argwhere(thing)[:, ::-1]
        if len(spots):
            near = [np.linalg.norm(spots - hands[i, side], axis=1).min() for i, side in beside]
            person, side = beside[np.argmin(near)]
            held = np.zeros((len(people), 2, *free.shape), bool) if held is None else held
            held[person, side] |= thing
            free &= ~thing
    return held


def _clear_mask(decoder: OnnxSession, embedding: ImageEmbedding, box: FloatArray) -> BoolArray:
    """Return the mask (H, W) of the thing in a box (4,) with its rim, empty if its border is not
    clear.
    """
    none = np.zeros((0, 2))
    answer = predict_masks(decoder, embedding, none, none, box)
    best = int(answer.iou.argmax())
    logits = answer.logits[best]
    stability = (logits > 1).sum() / max(1, (logits > -1).sum())
    if answer.iou[best] < MIN_IOU or stability < MIN_STABILITY:
        return np.zeros((embedding.height, embedding.width), bool)
    return dilate(embedding.to_photo(logits) > 0, embedding.cell)
