"""Errors of backends on worlds, which are reported, and limited for perfect networks alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.truth import (
    comparable_keypoints,
    contact_on_embedded,
    embedded_surface,
    rotation_errors_deg,
    true_hands,
    true_touch,
    true_wrists,
)
from physic_testing.metrics import BODY_JOINTS, contact_scores, mask_iou, mpjpe_mm, pa_mpjpe_mm

if TYPE_CHECKING:
    from physic_core.types import (
        AffineAmbiguity,
        Bodies,
        BoolArray,
        ContactProbability,
        DepthMap,
        FloatArray,
        Hands,
        Keypoints,
        Observations,
        People,
        Pointmap,
        UInt8Array,
    )
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case


MAIN_ERROR: dict[str, str] = {
    "segmenter": "IoU",
    "metric_depth": "abs-rel, scale fitted",
    "relative_pointmap": "abs-rel, aligned",
    "keypoint_detector": "share of person",
    "body_estimator": "MPJPE, mm",
    "hand_estimator": "degrees",
    "person_observer": "Brier",
    "contact_prior": "F1",
}
"""Interface -> name of the error by which two results are compared."""

SKY_BORDER_PX = 3
"""Distance from the sky up to which depths are not compared."""

CONTACT_THRESHOLD = 0.5
"""Probability above which a vertex counts as in contact."""


class ErrorKind(NamedTuple):
    """What is known of an error.

    Attributes:
        better: whether "higher" or "lower" is better.
        exact: worst value in a photo of a backend with the capability "exact"; NaN for none.
    """

    better: str
    exact: float = float("nan")


ERRORS: dict[str, ErrorKind] = {
    "IoU": ErrorKind("higher", 0.99),
    "floor IoU": ErrorKind("higher"),
    "PSNR in the hole, dB": ErrorKind("higher", 40),
    "abs-rel": ErrorKind("lower", 0.01),
    "abs-rel, scale fitted": ErrorKind("lower"),
    "abs-rel, aligned": ErrorKind("lower", 0.01),
    "share of person": ErrorKind("lower", 0.002),
    "MPJPE, mm": ErrorKind("lower", 5),
    "PA-MPJPE, mm": ErrorKind("lower"),
    "degrees": ErrorKind("lower", 1),
    "wrist degrees": ErrorKind("lower"),
    "Brier": ErrorKind("lower", 0.01),
    "F1": ErrorKind("higher", 0.99),
    "precision": ErrorKind("higher"),
    "recall": ErrorKind("higher"),
}
"""Error name, with its unit -> what is known of it."""


def measure_errors(interface: str, answer: Any, case: Case) -> dict[str, float]:
    """Measure the errors of one result against the ground truth.

    Args:
        interface: interface of the backend.
        answer: valid result of the backend.
        case: photo with ground truth.

    Returns:
        Error name of ERRORS -> value.

    Raises:
        CheckSkipped: worlds have no ground truth for this interface.
    """
    if interface not in _ERROR_FUNCTIONS:
        raise CheckSkipped(f"worlds have no ground truth for the interface {interface}")
    values = _ERROR_FUNCTIONS[interface](answer, case)
    return {name: float(np.mean(v)) if np.size(v) else np.nan for name, v in values.items()}


def main_error(interface: str, answer: Any, case: Case) -> float:
    """Return the error :data:`MAIN_ERROR` of a result, turned such that lower is better; NaN if it
    was not measured.

    Raises:
        CheckSkipped: worlds have no ground truth for this interface.
        BodyModelError: the result is of a body that cannot be compared.
    """
    name = MAIN_ERROR[interface]
    value = measure_errors(interface, answer, case).get(name, float("nan"))
    return 1 - value if ERRORS[name].better == "higher" else value


def check_is_exact(subject: BackendUnderTest) -> None:
    """The output is the truth in all photos of people, as the capability "exact" declares."""
    limits = {name: error.exact for name, error in ERRORS.items()} | subject.exact_limits
    for case, answer in subject.evidence():
        for name, value in measure_errors(subject.interface, answer, case).items():
            sign = 1 if ERRORS[name].better == "lower" else -1
            expect(
                not sign * value > sign * limits[name],
                f"{name} of {limits[name]:g} or better in all photos, as of a perfect network",
                f"{value:.3g} in the photo '{case.name}'",
                "Is it a factor, a shift, another order, a border, or resampling? If only some "
                "photos are wrong: is a photo of this shape turned back as it was turned?",
            )


def mean_errors(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Average each error over its finite values."""
    kept: dict[str, list[float]] = {}
    for name, value in (pair for row in rows for pair in row.items()):
        if np.isfinite(value):
            kept.setdefault(name, []).append(value)
    return {name: float(np.mean(values)) for name, values in kept.items()}


# Each function below returns the name of each error -> numbers whose mean it is.


def _segmenter(answer: People, case: Case) -> dict[str, Any]:
    truth = case.truth
    best = mask_iou(answer.masks, truth.masks).max(axis=0, initial=0.0)
    found = {"IoU": best}
    if answer.floor is not None:
        floor = truth.empty_floor_mask & ~truth.masks.any(axis=0)
        found["floor IoU"] = mask_iou(answer.floor[None], floor[None])
    return found


def _inpainter(answer: UInt8Array, case: Case) -> dict[str, Any]:
    error = (answer.astype(float) - case.empty)[case.hole]
    return {"PSNR in the hole, dB": 10 * np.log10(255**2 / max((error**2).mean(), 1e-2))}


def _metric_depth(answer: DepthMap, case: Case) -> dict[str, Any]:
    truth = case.truth.empty_depth.astype(np.float64)
    both = np.isfinite(answer.depth) & inner_pixels(np.isfinite(truth))
    ratio = answer.depth[both] / truth[both]
    fitted = ratio / np.median(ratio)
    return {"abs-rel": np.abs(ratio - 1), "abs-rel, scale fitted": np.abs(fitted - 1)}


def _relative_pointmap(answer: Pointmap, case: Case) -> dict[str, Any]:
    truth = case.truth.empty_depth.astype(np.float64)
    both = answer.valid & inner_pixels(np.isfinite(truth))
    ratio = fit_ambiguity(answer.points[..., 2][both], truth[both], answer.unknown)
    return {"abs-rel, aligned": np.abs(ratio - 1)}


def inner_pixels(mask: BoolArray) -> BoolArray:
    """Return the pixels of a mask (H, W) that are not within SKY_BORDER_PX of its border, where
    resampling mixes depths.
    """
    import cv2

    brush = np.ones((2 * SKY_BORDER_PX + 1,) * 2, np.uint8)
    inner: BoolArray = cv2.erode(mask.astype(np.uint8), brush, borderValue=1) > 0
    return inner


def _keypoint_detector(answer: Keypoints, case: Case) -> dict[str, Any]:
    found, true, visible = comparable_keypoints(answer, case.truth)
    seen = visible & (found.confidence > 0)
    error = np.linalg.norm(found.points - true, axis=2)
    return {"share of person": (error / case.box_sides[:, None])[seen]}


def _body_estimator(answer: Bodies, case: Case) -> dict[str, Any]:
    joints = embedded_surface(answer)[1][:, BODY_JOINTS]
    true = case.truth.joints[:, BODY_JOINTS].astype(np.float64)
    return {"MPJPE, mm": mpjpe_mm(joints, true), "PA-MPJPE, mm": pa_mpjpe_mm(joints, true)}


def _hand_estimator(answer: Hands, case: Case) -> dict[str, Any]:
    shown = answer.confidence > 0
    degrees = rotation_errors_deg(answer.rotvecs, true_hands(case.truth))
    found = {"degrees": degrees[shown]}
    if answer.wrists is not None:
        found["wrist degrees"] = rotation_errors_deg(answer.wrists, true_wrists(case.truth))[shown]
    return found


def _person_observer(answer: Observations, case: Case) -> dict[str, Any]:
    off = answer.touch - true_touch(case.truth)
    return {"Brier": off[np.isfinite(off)] ** 2}


def _contact_prior(answer: ContactProbability, case: Case) -> dict[str, Any]:
    likely = contact_on_embedded(answer).probability > CONTACT_THRESHOLD
    scores = contact_scores(likely, case.truth.contact)
    return {"F1": scores.f1_mean, "precision": scores.precision_mean, "recall": scores.recall_mean}


_ROUNDS = 8
_FITTED = 2000  # pixels of a photo that take part in a fit


def fit_ambiguity(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> FloatArray:
    """Fit the unknown scale and shift of depths (M,) robustly; return fitted over true depth."""
    z, truth = (side.astype(np.float64) for side in (z, truth))
    # Each row: fitted depth / true depth = 1, in the space in which the unknowns are linear.
    columns = {
        "scale": [z / truth],
        "scale_shift": [z / truth, 1 / truth],
        "inverse_scale_shift": [truth / z, truth],
    }
    every = np.stack(columns[unknown], axis=1)
    design = every[:: max(1, len(z) // _FITTED)]
    weight = np.ones(len(design))
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(design * weight[:, None], weight, rcond=None)[0]
        residual = np.abs(design @ found - 1)
        weight = 1 / np.sqrt(1 + (residual / (2 * np.median(residual) + 1e-9)) ** 2)
    fitted: FloatArray = every @ found
    return 1 / np.maximum(fitted, 1e-3) if unknown == "inverse_scale_shift" else fitted


_ERROR_FUNCTIONS: dict[str, Callable[[Any, Case], dict[str, Any]]] = {
    "segmenter": _segmenter,
    "inpainter": _inpainter,
    "metric_depth": _metric_depth,
    "relative_pointmap": _relative_pointmap,
    "keypoint_detector": _keypoint_detector,
    "body_estimator": _body_estimator,
    "hand_estimator": _hand_estimator,
    "person_observer": _person_observer,
    "contact_prior": _contact_prior,
}
