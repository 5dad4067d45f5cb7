"""Doubt the head of a person whom the border of the image cuts off below the head, hips at the
lower end of what is seen, and all below a trunk that is too short for its face.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Keypoints

# Points of blazepose33.
_HEAD = slice(0, 11)
_EYES = [2, 5]
_MOUTH = slice(9, 11)
_SHOULDERS = slice(11, 13)
_HIPS = slice(23, 25)
_LEGS = slice(25, 29)  # knees and ankles
_BELOW_TRUNK = slice(23, 33)

_SEEN_LEG = 0.3  # confidence of a knee or an ankle that is seen
_LEAST_BELOW = 0.4  # lengths of the trunk that are seen below hips whose place is known
_DOUBTFUL = 0.2
_SQUEEZED = 0.25  # from eyes to mouth in lengths of the trunk: more than of children


def doubt_cut_heads(keypoints: Keypoints, masks: BoolArray) -> Keypoints:
    """Set the confidence of head and shoulders to 0 for people whose head is outside of the image.

    BlazePose puts a head into each crop, with full confidence. If the head is outside, it lies on
    the chest, and the trunk that is fitted to it bends forward. Such a head has two signs: it lies
    on the hips' side of the shoulders, and the border of the image beyond the shoulders cuts the
    mask at least as wide as the shoulders are apart.

    Args:
        keypoints: joints of skeleton "blazepose33" of N people.
        masks: (N, H, W), their pixels.
    """
    cut = np.array([_is_cut(p, m) for p, m in zip(keypoints.points, masks, strict=True)], bool)
    confidence = keypoints.confidence.copy()
    confidence[cut, _HEAD] = confidence[cut, _SHOULDERS] = 0
    return replace(keypoints, confidence=confidence)


def doubt_hidden_hips(keypoints: Keypoints, masks: BoolArray) -> Keypoints:
    """Lower the confidence of hips of people who are seen only down to the hips.

    BlazePose puts the hips of people whom something hides below the waist to the lower end of what
    is seen, with full confidence. The trunk then looks short, and bends forward. Where the trunk is
    too short for the face, the legs are squeezed too. Arguments as in :func:`doubt_cut_heads`.
    """
    confidence = keypoints.confidence.copy()
    squeezed = face_ratios(keypoints.points) > _SQUEEZED
    confidence[squeezed, _BELOW_TRUNK] = confidence[squeezed, _BELOW_TRUNK].clip(max=_DOUBTFUL)
    hidden = confidence[:, _LEGS].max(1, initial=0) < _SEEN_LEG
    for i in np.flatnonzero(hidden):
        if _below_hips(keypoints.points[i], masks[i]) < _LEAST_BELOW:
            confidence[i, _HIPS] = confidence[i, _HIPS].clip(max=_DOUBTFUL)
    return replace(keypoints, confidence=confidence)


def face_ratios(points: FloatArray) -> FloatArray:
    """Return the lengths (N,) from eyes to mouth over those of the trunk, joints (N, 33, 2) px."""

    def length(first: slice | list[int], second: slice) -> FloatArray:
        ends = points[:, first].mean(axis=1) - points[:, second].mean(axis=1)
        return np.asarray(np.linalg.norm(ends, axis=-1))

    return length(_EYES, _MOUTH) / np.maximum(length(_SHOULDERS, _HIPS), 1e-6)


def _below_hips(points: FloatArray, mask: BoolArray) -> float:
    """Return how far the mask (H, W) of one person reaches below the hips, joints (33, 2) px, in
    lengths of the trunk.
    """
    hips = points[_HIPS].astype(float).mean(axis=0)
    trunk = hips - points[_SHOULDERS].astype(float).mean(axis=0)
    rows, columns = np.nonzero(mask)
    if not len(rows) or not trunk.any():
        return 0.0
    below = (np.stack([columns, rows], axis=1) - hips) @ trunk / (trunk @ trunk)
    return float(below.max())


def _is_cut(points: FloatArray, mask: BoolArray) -> bool:
    """Return whether the head of one person, joints (33, 2) px and mask (H, W), is outside of the
    image.
    """
    shoulders = points[_SHOULDERS].astype(float)
    hips = points[_HIPS].astype(float)
    up = shoulders.mean(axis=0) - hips.mean(axis=0)
    on_chest = (points[_HEAD].mean(axis=0) - shoulders.mean(axis=0)) @ up < 0
    width_px = _border_beyond(up, mask).sum()
    return bool(on_chest and width_px >= max(np.linalg.norm(shoulders[0] - shoulders[1]), 1.0))


def _border_beyond(up: FloatArray, mask: BoolArray) -> BoolArray:
    """Return the row or column of a mask (H, W) at the border that the direction ``up`` (x, y)
    points to.
    """
    if abs(up[0]) > abs(up[1]):
        border: BoolArray = mask[:, -1] if up[0] > 0 else mask[:, 0]
    else:
        border = mask[-1] if up[1] > 0 else mask[0]
    return border
