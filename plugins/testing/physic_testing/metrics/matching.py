"""One-to-one matching of predicted people to true people.

The Hungarian method maximises the number of allowed matches, then minimises their total cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from physic_core.backends import people
from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Int64Array


@dataclass(frozen=True)
class Matching:
    """Matched and unmatched indices of predicted and true people.

    Attributes:
        predicted: (M,) int64; ``predicted[i]`` matches ``truth[i]``.
        truth: (M,) int64, in increasing order.
        missed: (K,) int64, true people without a match.
        false_alarms: (L,) int64, predictions without a match.
    """

    predicted: Int64Array
    truth: Int64Array
    missed: Int64Array
    false_alarms: Int64Array

    @property
    def predicted_of(self) -> dict[int, int]:
        """True person -> predicted person."""
        return dict(zip(self.truth.tolist(), self.predicted.tolist(), strict=True))


def mask_iou(predicted: BoolArray, truth: BoolArray) -> FloatArray:
    """Return the intersection over union (N, M) of masks (N, H, W) and (M, H, W) bool; 0 for two
    empty masks.

    Raises:
        PhysicError: the image sizes differ.
    """
    if predicted.shape[1:] != truth.shape[1:]:
        raise PhysicError(
            f"Masks must have one size, got {predicted.shape[1:]} and {truth.shape[1:]}: resize "
            f"one of them first."
        )
    return people.mask_iou(predicted, truth)


def match_by_masks(predicted: BoolArray, truth: BoolArray, min_iou: float = 0.5) -> Matching:
    """Match people by the overlap of their masks.

    Args:
        predicted: (N, H, W) bool, N may be 0.
        truth: (M, H, W) bool, M may be 0.
        min_iou: least IoU of a match; masks without overlap never match.

    Raises:
        PhysicError: the image sizes differ.
    """
    iou = mask_iou(predicted, truth)
    return assign(1.0 - iou, (iou >= min_iou) & (iou > 0))


def match_by_boxes(
    predicted: Sequence[Sequence[float] | FloatArray],
    truth: Sequence[Sequence[float] | FloatArray],
    min_iou: float,
) -> Matching:
    """Match people by the overlap of their boxes.

    Args:
        predicted: N boxes x0 y0 x1 y1.
        truth: M boxes.
        min_iou: least IoU of a match.
    """
    boxes, others = (np.array([*some], np.float64).reshape(-1, 4) for some in (predicted, truth))
    iou = people.box_iou(boxes, others)
    return assign(-iou, iou >= min_iou)


def assign(cost: FloatArray, allowed: BoolArray) -> Matching:
    """Match people by costs of your own.

    Args:
        cost: (N, M) of each predicted and each true person, finite.
        allowed: (N, M) bool, pairs that may match.
    """
    usual = np.where(allowed, cost, 0.0)
    # A forbidden pair costs more than any set of allowed pairs.
    rows, columns = linear_sum_assignment(
        np.where(allowed, cost, usual.max(initial=0.0) * min(cost.shape) + 1.0)
    )
    is_allowed = allowed[rows, columns]
    rows = rows[is_allowed].astype(np.int64)
    columns = columns[is_allowed].astype(np.int64)
    order = np.argsort(columns)
    return Matching(
        predicted=rows[order],
        truth=columns[order],
        missed=np.setdiff1d(np.arange(cost.shape[1]), columns),
        false_alarms=np.setdiff1d(np.arange(cost.shape[0]), rows),
    )
