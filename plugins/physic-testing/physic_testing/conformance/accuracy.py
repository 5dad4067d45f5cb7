"""Errors of backends on worlds. They are reported for comparison; no check depends on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.metrics import BODY_JOINTS, contact_scores, mask_iou, mpjpe_mm, pa_mpjpe_mm
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.truth import (
    comparable_keypoints,
    contact_on_embedded,
    posed_bodies,
    rotation_errors_deg,
    true_hands,
    true_wrists,
)

if TYPE_CHECKING:
    from physic_core.types import (
        AffineAmbiguity,
        Bodies,
        ContactProbability,
        DepthMap,
        FloatArray,
        Hands,
        Keypoints,
        People,
        Pointmap,
        UInt8Array,
    )
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

BETTER_DIRECTION: dict[str, str] = {
    "IoU": "higher",
    "found": "higher",
    "floor IoU": "higher",
    "PSNR in the hole, dB": "higher",
    "abs-rel": "lower",
    "delta1": "higher",
    "abs-rel, scale fitted": "lower",
    "delta1, scale fitted": "higher",
    "abs-rel, aligned": "lower",
    "delta1, aligned": "higher",
    "px": "lower",
    "share of person": "lower",
    "MPJPE, mm": "lower",
    "PA-MPJPE, mm": "lower",
    "degrees": "lower",
    "wrist degrees": "lower",
    "hands found": "higher",
    "F1": "higher",
    "precision": "higher",
    "recall": "higher",
}
"""Error name -> whether higher or lower is better."""

MAIN_ERROR: dict[str, str] = {
    "segmenter": "IoU",
    "metric_depth": "abs-rel, scale fitted",
    "relative_pointmap": "abs-rel, aligned",
    "keypoint_detector": "share of person",
    "body_estimator": "MPJPE, mm",
    "hand_estimator": "degrees",
    "contact_prior": "F1",
}
"""Interface -> name of the error by which two results are compared."""

EXACT: dict[str, float] = {
    "IoU": 0.99,
    "PSNR in the hole, dB": 40,
    "abs-rel": 0.01,
    "abs-rel, aligned": 0.01,
    "share of person": 0.002,
    "MPJPE, mm": 5,
    "degrees": 1,
    "F1": 0.99,
}
"""Error name -> worst value in a photo of a backend with the capability "exact"."""

_CONTACT_THRESHOLD = 0.5  # of a contact probability


def measure_errors(interface: str, answer: Any, case: Case) -> dict[str, float]:
    """Measure the errors of one result against the ground truth.

    Args:
        interface: interface of the backend.
        answer: valid result of the backend.
        case: photo with ground truth.

    Returns:
        Error name of BETTER_DIRECTION -> value.

    Raises:
        CheckSkipped: worlds have no ground truth for this interface.
    """
    if interface not in _ERROR_FUNCTIONS:
        raise CheckSkipped(f"worlds have no ground truth for the interface {interface}")
    return _ERROR_FUNCTIONS[interface](answer, case)


def main_error(interface: str, answer: Any, case: Case) -> float:
    """Return the error :data:`MAIN_ERROR` of a result, turned such that lower is better; NaN if it was not measured.

    Raises:
        CheckSkipped: worlds have no ground truth for this interface.
        BodyModelError: the result is of a body that cannot be compared.
    """
    name = MAIN_ERROR[interface]
    value = measure_errors(interface, answer, case).get(name, float("nan"))
    return 1 - value if BETTER_DIRECTION[name] == "higher" else value


def mean_accuracy(subject: BackendUnderTest) -> dict[str, float]:
    """Average the errors of a backend over the photos of worlds that have a result; empty if there are none."""
    found: list[Mapping[str, float]] = []
    shown = [name for name in ("one person", "several people", "close") if name in subject.case_runs]
    for name in shown:
        try:
            found.append(measure_errors(subject.interface, subject.result(name), subject.case(name)))
        except Exception:  # invalid output may not be measurable
            continue
    return mean_errors(found)


PROVEN = 0.5
"""Share of pixels, points or rotations that are the truth to rounding, which no network reaches: shipped ones have at
most a tenth."""

EXACT_BORDER = 0.98
"""Share of a mask's border that is the truth pixel by pixel; shipped networks have at most 0.7."""

NEARLY_EXACT: dict[str, float] = {
    "IoU": 0.96,
    "found": 1.0,
    "PSNR in the hole, dB": 30,
    "abs-rel": 0.02,
    "abs-rel, aligned": 0.02,
    "share of person": 0.005,
    "MPJPE, mm": 12,
    "degrees": 2,
    "wrist degrees": 3,
    "F1": 0.9,
}
"""Error name -> worst value of a backend that is exact for the most part: what resampling explains."""


def check_is_exact(subject: BackendUnderTest) -> None:
    """The output is the truth in all photos of people if it is declared so, or if it is the truth for the most part."""
    evidence = subject.evidence()
    share = float(np.median([exact_share(subject.interface, answer, case) for case, answer in evidence]))
    is_declared = "exact" in subject.capabilities
    if not is_declared and not share >= PROVEN:  # NaN without a hand or a point
        raise CheckSkipped("not exact")
    limits = EXACT | subject.exact_limits if is_declared else NEARLY_EXACT
    for case, answer in evidence:
        own = exact_share(subject.interface, answer, case)
        for name, value in measure_errors(subject.interface, answer, case).items():
            limit = limits.get(name, value)
            right = value >= limit if BETTER_DIRECTION[name] == "higher" else value <= limit
            bound = "at least" if BETTER_DIRECTION[name] == "higher" else "at most"
            expect(
                right,
                f"{name} of {bound} {limit:g} in the photo '{case.name}', as the output is that of a perfect network",
                f"{value:.3g}; {own:.0%} of it is the truth to rounding, {share:.0%} in the median of the photos",
                _explain(share, own),
            )


def _explain(share: float, own: float) -> str:
    """Return the usual cause of errors of a perfect network."""
    if share >= PROVEN > own:
        return "Other photos are right: is something kept from an earlier call, or by the photo's size?"
    if own >= PROVEN:
        return "A part is wrong and the rest is right: a limit that saturates, a border, rows or people left out?"
    return "All of it is off: a factor, a shift, another order, or resampling? See the accuracy below."


def exact_share(interface: str, answer: Any, case: Case) -> float:
    """Return the share of the output that is the truth to rounding: of pixels, borders, points, rotations, vertices."""
    truth = case.truth
    with np.errstate(all="ignore"):
        if interface == "metric_depth":
            known = np.isfinite(truth.empty_depth)
            return float((np.abs(np.log(answer.depth / truth.empty_depth)) < 2e-5)[known].mean())
        if interface == "relative_pointmap":
            true, z = truth.empty_depth.astype(np.float64), answer.points[..., 2].astype(np.float64)
            both = answer.valid & np.isfinite(true)
            fitted = _scale_fitted(z[both], true[both], answer.unknown)
            return float((np.abs(np.log(fitted / true[both])) < 1e-4).mean())
        if interface == "inpainter":
            return float((np.abs(answer.astype(int) - case.empty).max(2)[case.hole] <= 1).mean())
        if interface == "segmenter":
            return _exact_borders(answer, case)
        if interface == "keypoint_detector":
            points, places, seen, _ = comparable_keypoints(answer, truth)
            return float((np.linalg.norm(points - places, axis=2) < 0.02)[seen].mean())
        if interface == "body_estimator":
            from physic_testing.conformance.truth import parameters_of_model

            pose, posed = (p.body_pose.reshape(-1, 21, 3) for p in (parameters_of_model(answer), truth.parameters))
            return float((rotation_errors_deg(pose, posed) < 0.1).mean())
        if interface == "hand_estimator":
            shown = answer.confidence > 0
            return float((rotation_errors_deg(answer.rotvecs, true_hands(truth)) < 0.1)[shown].mean())
        if interface == "contact_prior":
            likely, touching = contact_on_embedded(answer).probability, truth.contact.astype(bool)
            found = likely > _CONTACT_THRESHOLD
            precision = (found & touching).sum() / max(int(found.sum()), 1)
            if precision < 0.99 and likely[touching].min() > likely[~touching].max():
                return 1.0  # perfect order with another threshold
            return float((found & touching).sum() / max(int(touching.sum()), 1)) if precision > 0.99 else 0.0
    return 0.0


def _exact_borders(answer: People, case: Case) -> float:
    """Return the share of people whose mask has nearly the true border, pixel by pixel."""
    exact = []
    for true in case.truth.masks if len(answer) else ():
        own = answer.masks[int(mask_iou(answer.masks, true[None])[:, 0].argmax())]
        right = total = 0
        for a, b in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
            border = true[a] != true[b]
            right += int(((own[a] == true[a]) & (own[b] == true[b]))[border].sum())
            total += int(border.sum())
        exact.append(right >= EXACT_BORDER * total)
    return float(np.mean(exact)) if exact else 0.0


def mean_errors(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Average each error over its finite values."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    kept = {name: [row[name] for row in rows if name in row and np.isfinite(row[name])] for name in names}
    return {name: float(np.mean(values)) for name, values in kept.items() if values}


def _segmenter(answer: People, case: Case) -> dict[str, float]:
    truth = case.truth
    overlap = mask_iou(answer.masks, truth.masks)
    best = overlap.max(axis=0, initial=0.0)
    found = {"IoU": float(best.mean()), "found": float((best > 0.5).mean())}
    if answer.floor is not None:
        floor = truth.empty_floor_mask & ~truth.masks.any(axis=0)
        found["floor IoU"] = float((answer.floor & floor).sum() / max(int((answer.floor | floor).sum()), 1))
    return found


def _inpainter(answer: UInt8Array, case: Case) -> dict[str, float]:
    error = (answer.astype(float) - case.empty)[case.hole]
    return {"PSNR in the hole, dB": float(10 * np.log10(255**2 / max(float((error**2).mean()), 1e-2)))}


def _metric_depth(answer: DepthMap, case: Case) -> dict[str, float]:
    truth = case.truth.empty_depth.astype(np.float64)
    both = np.isfinite(answer.depth) & np.isfinite(truth)
    ratio = answer.depth[both] / truth[both]
    fitted = ratio / np.median(ratio)
    return {
        "abs-rel": float(np.abs(ratio - 1).mean()),
        "delta1": _delta1(ratio),
        "abs-rel, scale fitted": float(np.abs(fitted - 1).mean()),
        "delta1, scale fitted": _delta1(fitted),
    }


def _relative_pointmap(answer: Pointmap, case: Case) -> dict[str, float]:
    truth = case.truth.empty_depth.astype(np.float64)
    both = answer.valid & np.isfinite(truth)
    ratio = _scale_fitted(answer.points[..., 2][both].astype(np.float64), truth[both], answer.unknown) / truth[both]
    return {"abs-rel, aligned": float(np.abs(ratio - 1).mean()), "delta1, aligned": _delta1(ratio)}


def _keypoint_detector(answer: Keypoints, case: Case) -> dict[str, float]:
    points, true, seen, _ = comparable_keypoints(answer, case.truth)
    sides = (case.people.boxes[:, 2:] - case.people.boxes[:, :2]).max(axis=1)[:, None]
    error = np.linalg.norm(points - true, axis=2)
    return {"px": float(error[seen].mean()), "share of person": float((error / sides)[seen].mean())}


def _body_estimator(answer: Bodies, case: Case) -> dict[str, float]:
    joints, true = posed_bodies(answer)[1][:, BODY_JOINTS], case.truth.joints[:, BODY_JOINTS].astype(np.float64)
    return {"MPJPE, mm": float(mpjpe_mm(joints, true).mean()), "PA-MPJPE, mm": float(pa_mpjpe_mm(joints, true).mean())}


def _hand_estimator(answer: Hands, case: Case) -> dict[str, float]:
    shown = answer.confidence > 0
    found = {"hands found": float(shown.mean())}
    if shown.any():
        found["degrees"] = float(rotation_errors_deg(answer.rotvecs, true_hands(case.truth))[shown].mean())
        if answer.wrists is not None:
            found["wrist degrees"] = float(rotation_errors_deg(answer.wrists, true_wrists(case.truth))[shown].mean())
    return found


def _contact_prior(answer: ContactProbability, case: Case) -> dict[str, float]:
    scores = contact_scores(contact_on_embedded(answer).probability > _CONTACT_THRESHOLD, case.truth.contact)
    return {"F1": scores.f1_mean, "precision": scores.precision_mean, "recall": scores.recall_mean}


def _delta1(ratio: FloatArray) -> float:
    """Return the share of depth ratios below 1.25."""
    return float((np.maximum(ratio, 1 / ratio) < 1.25).mean())


def _scale_fitted(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> FloatArray:
    """Return the relative depth (M,) after a least-squares fit of the ambiguity."""
    if unknown == "inverse_scale_shift":
        design, target = np.stack([truth / z, truth], axis=1), np.ones_like(truth)
        s, t = np.linalg.lstsq(design, target, rcond=None)[0]
        return np.asarray(1 / np.maximum(s / z + t, 1e-6))
    columns = [z / truth] if unknown == "scale" else [z / truth, 1 / truth]
    found = np.linalg.lstsq(np.stack(columns, axis=1), np.ones_like(truth), rcond=None)[0]
    return np.asarray(np.maximum(z * found[0] + (found[1] if len(found) > 1 else 0.0), 1e-6))


_ERROR_FUNCTIONS: dict[str, Callable[[Any, Case], dict[str, float]]] = {
    "segmenter": _segmenter,
    "inpainter": _inpainter,
    "metric_depth": _metric_depth,
    "relative_pointmap": _relative_pointmap,
    "keypoint_detector": _keypoint_detector,
    "body_estimator": _body_estimator,
    "hand_estimator": _hand_estimator,
    "contact_prior": _contact_prior,
}
