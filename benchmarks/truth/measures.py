"""Errors of one person, floor or picture against its truth: metres and px in, numbers out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.truth.joints import bone_lengths, root
from physic_core.backends.people import box_iou
from physic_testing.metrics import assign, mpjpe_mm, pa_mpjpe_mm

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MIN_IOU = 0.5
CALIBRATION_BINS = 10
SCORES = ("auc", "brier", "constant", "recall", "specificity", "balanced", "calibration")
"""Names of the scores of probabilities."""

FORCE_SHARE = 0.05
"""A limb touches where its force is above this share of the largest force of its film."""


def pose_errors(predicted: Array, truth: Array) -> dict[str, Any]:
    """Of (12, 3) m in the camera's frame. Joints that the truth lacks do not count."""
    is_known = np.isfinite(truth).all(-1)
    lengths = bone_lengths(predicted)
    true = bone_lengths(truth)
    both = [name for name in true if np.isfinite(true[name]) and np.isfinite(lengths[name])]
    ratio = (
        sum(lengths[name] for name in both) / sum(true[name] for name in both)
        if both
        else float("nan")
    )
    pelvis = root(predicted, is_known)
    true_pelvis = root(truth, is_known)
    return {
        "pa_mpjpe_mm": float(pa_mpjpe_mm(predicted, truth, is_known)),
        "root_aligned_mm": float(mpjpe_mm(predicted - pelvis, truth - true_pelvis, is_known)),
        "mpjpe_mm": float(mpjpe_mm(predicted, truth, is_known)),
        "pelvis_mm": float(1000 * np.linalg.norm(pelvis - true_pelvis)),
        "pelvis_depth_ratio": float(pelvis[2] / true_pelvis[2]),
        "bones_ratio": ratio,
        "joint_errors_m": np.linalg.norm(
            predicted - pelvis - truth + true_pelvis, axis=-1
        ).tolist(),
    }


def box_of(points: Array) -> Array:
    """Box (4,) of joints (12, 2) px, grown by a tenth: a body is larger than its joints."""
    low = np.nanmin(points, 0)
    high = np.nanmax(points, 0)
    margin = 0.1 * float((high - low).max())
    return np.concatenate([low - margin, high + margin])


def share_inside(points: Array, box: Sequence[float]) -> float:
    """Share of the known (J, 2) points that lie in a box; 0 without points."""
    finite = points[np.isfinite(points).all(-1)]
    inside = ((finite >= box[:2]) & (finite <= box[2:])).all(-1)
    return float(inside.mean()) if len(finite) else 0.0


def match_people(
    boxes: Sequence[Sequence[float]],
    points: Sequence[Array],
    true_boxes: Sequence[Sequence[float]],
    true_points: Sequence[Array],
) -> dict[int, int]:
    """True person -> found person, one to one.

    Somebody is found where the boxes overlap by more than half, or where most of the true keypoints
    lie in the found box and most of the found ones in the true box: boxes of half hidden people
    differ by what is guessed of them.
    """
    iou = box_iou(*(np.array(some, np.float64).reshape(-1, 4) for some in (boxes, true_boxes)))
    truth = list(zip(true_boxes, true_points, strict=True))
    mutual = np.array(
        [
            [
                min(share_inside(true, box), share_inside(joints, true_box))
                for true_box, true in truth
            ]
            for box, joints in zip(boxes, points, strict=True)
        ]
    ).reshape(iou.shape)
    return assign(-iou - mutual, (iou > MIN_IOU) | (mutual > 0.5)).predicted_of


def points_error(
    predicted: Array, truth: Array, counted: NDArray[np.bool_], box: Sequence[float]
) -> list[float]:
    """Distance of each counted joint (J, 2) px as a share of the box's diagonal."""
    diagonal = float(np.hypot(box[2] - box[0], box[3] - box[1]))
    distance = np.linalg.norm(predicted - truth, axis=-1)[counted & np.isfinite(truth).all(-1)]
    return [float(d) / diagonal for d in distance if np.isfinite(d)]


def true_contact(forces: Array) -> NDArray[np.bool_]:
    """(n, 4) bool of (n, 4, 6) forces and moments of one film."""
    size = np.linalg.norm(forces[..., :3], axis=-1)
    touching: NDArray[np.bool_] = size > FORCE_SHARE * size.max()
    return touching


def probability_scores(probability: Sequence[float], truth: Sequence[bool]) -> dict[str, float]:
    """Scores of probabilities (n,) of something that is true or not; NaN for what has no case.

    ``brier`` is the mean squared error, ``constant`` that of the base rate of these cases.
    ``recall``, ``specificity`` and ``balanced`` (their mean) are at one half. ``calibration`` is
    the expected calibration error in ten bins, mean |probability - share of true cases|.
    """
    chances = np.array(probability, np.float64)
    fact = np.array(truth, bool)
    if not len(fact):
        return dict.fromkeys(SCORES, float("nan"))
    is_likely = chances >= 0.5
    rate = fact.mean()
    right = is_likely[fact], ~is_likely[~fact]
    recall, specificity = (float(cases.mean()) if len(cases) else float("nan") for cases in right)
    above = chances[fact][:, None] - chances[~fact]
    index = np.minimum((chances * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    off = np.bincount(index, chances - fact, CALIBRATION_BINS)
    return {
        "auc": float(((above > 0) + 0.5 * (above == 0)).mean()) if above.size else float("nan"),
        "brier": float(np.square(chances - fact).mean()),
        "constant": float(rate * (1 - rate)),
        "recall": recall,
        "specificity": specificity,
        "balanced": (recall + specificity) / 2,
        "calibration": float(np.abs(off).sum() / len(chances)),
    }


def depth_errors(depth: Array, truth: Array) -> dict[str, float]:
    """Mean |Z - Z*| / Z* over the pixels that both maps know: as it comes, and after the factor of
    the medians.
    """
    is_known = np.isfinite(depth) & np.isfinite(truth) & (truth > 0) & (depth > 0)
    if not is_known.any():
        return {"absrel": float("nan"), "absrel_scaled": float("nan")}
    estimated = depth[is_known]
    true = truth[is_known]
    factor = float(np.median(true / estimated))
    return {
        "absrel": float((np.abs(estimated - true) / true).mean()),
        "absrel_scaled": float((np.abs(factor * estimated - true) / true).mean()),
    }


def spread_m(places: Array) -> float:
    """Root mean squared distance of (n, 3) places from their mean; NaN of fewer than two."""
    if len(places) < 2:
        return float("nan")
    return float(np.sqrt(np.square(places - places.mean(0)).sum(-1).mean()))
