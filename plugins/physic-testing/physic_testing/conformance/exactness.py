"""The check that the output of a perfect network is the truth, and words for what is off if it is not.

A wrapper of a network is tested alone with a network that knows the truth. Whether a backend is such a wrapper shows in
its output: no real network returns the truth to rounding, or exact multiples of it, for half of what it returns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.metrics import mask_iou
from physic_testing.conformance.accuracy import BETTER_DIRECTION, CONTACT_THRESHOLD, measure_errors, scale_fitted
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.truth import (
    comparable_keypoints,
    contact_on_embedded,
    parameters_of_model,
    true_hands,
)

if TYPE_CHECKING:
    from physic_core.types import FloatArray, People
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

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
"""The same of a backend whose output proves it to be exact: what resampling explains."""

PROVEN = 0.5
"""Share of pixels, points or rotations on one line with the truth; shipped networks have at most a tenth."""

EXACT_BORDER = 0.98
"""Share of a mask's border that is the truth pixel by pixel; shipped networks have at most 0.7."""

MAX_LARGEST = 0.02
"""Share of an output that may be its largest value; more of it is clipped."""

MAX_FACTOR = 0.02
"""Deviation of the common factor from 1 that is treated as zero."""

FACTORS = (0.3, 3.0)
"""Factors of a line that can prove anything: a constant lies on one of factor 0."""

_TURNS = {"turned by 180 degrees": (-1, -1), "mirrored": (1, -1), "upside down": (-1, 1)}
"""Words -> steps of rows and columns."""

_SAMPLES, _LINES = 4000, 64


@dataclass(frozen=True)
class Agreement:
    """How an output agrees with the truth of a photo.

    Attributes:
        share: share of the output that is the truth to rounding.
        on_line: share that is offset + factor * truth to rounding; the better of this line and the truth itself.
        factor: of that line; a power for depth, which is compared in logarithms.
        offset: of that line, in the unit of the values.
    """

    share: float
    on_line: float
    factor: float = 1.0
    offset: float = 0.0


def check_is_exact(subject: BackendUnderTest) -> None:
    """The output is the truth in all photos of people if this is declared, or if the output itself proves it."""
    evidence = subject.evidence()
    found = [agreement(subject.interface, answer, case) for case, answer in evidence]
    share, on_line = (float(np.median(values)) for values in zip(*((a.share, a.on_line) for a in found), strict=True))
    is_declared = "exact" in subject.capabilities
    if not is_declared and on_line < PROVEN:
        raise CheckSkipped("not exact")
    limits = EXACT | subject.exact_limits if is_declared else NEARLY_EXACT
    if not is_declared and share < PROVEN and subject.interface == "metric_depth":
        limits = {}  # the scale of real depth is an estimate; 'depth_has_no_bias_of_scale' judges its mean
    for (case, _), own in zip(evidence, found, strict=True):
        expect(
            own.on_line < PROVEN or abs(own.factor - 1) < MAX_FACTOR,
            f"the truth in the photo '{case.name}', as of a perfect network",
            f"{_line_in_words(subject.interface, own)} in {own.on_line:.0%} of the output",
            "Is it a scale, a unit, a gamma or a mean that the network's authors state?",
        )
    errors = [measure_errors(subject.interface, answer, case) for case, answer in evidence]
    for name, limit in limits.items():
        values = {i: row[name] for i, row in enumerate(errors) if name in row}
        if not values:
            continue
        is_higher = BETTER_DIRECTION[name] == "higher"
        worst = (min if is_higher else max)(values, key=lambda i: values[i])
        if values[worst] < limit if is_higher else values[worst] > limit:
            (case, answer), own = evidence[worst], found[worst]
            raise CheckFailed(
                f"the truth in all photos, as of a perfect network: {name} of at {'least' if is_higher else 'most'} "
                f"{limit:g}",
                f"{values[worst]:.3g} in the photo '{case.name}', where {own.share:.0%} of the output is the truth; "
                f"{share:.0%} in the median of the photos",
                _explain(subject, case, answer, own, share),
            )


def _turn(interface: str, answer: Any, case: Case) -> str:
    """Return in words which turn of an output is the truth; empty if none is."""
    for words, (down, right) in _TURNS.items():
        rows, columns = slice(None, None, down), slice(None, None, right)
        if interface == "inpainter":
            turned = answer[rows, columns]
        elif interface == "metric_depth":
            turned = replace(answer, depth=answer.depth[rows, columns])
        elif interface == "relative_pointmap":
            turned = replace(answer, points=answer.points[rows, columns], valid=answer.valid[rows, columns])
        elif interface == "segmenter":
            turned = replace(answer, masks=answer.masks[:, rows, columns])
        elif interface == "keypoint_detector":
            height, width = case.photo.shape[:2]
            turned = replace(
                answer, points=answer.points * [right, down] + [(right < 0) * (width - 1), (down < 0) * (height - 1)]
            )
        else:
            return ""
        if agreement(interface, turned, case).share >= PROVEN:
            return words
    return ""


def _line_in_words(interface: str, own: Agreement) -> str:
    """Return the line of an output as text."""
    if interface in ("metric_depth", "relative_pointmap"):
        return f"{np.exp(own.offset):.3g} times the power {own.factor:.3g} of the depth"
    return f"{own.factor:.3g} times the truth, {own.offset:+.2g}"


def _explain(subject: BackendUnderTest, case: Case, answer: Any, own: Agreement, share: float) -> str:
    """Return what is off in a photo, by how much, and its usual cause."""
    interface = subject.interface
    turn = _turn(interface, answer, case)
    if turn:
        return f"It is the truth {turn}: is a photo of this shape turned for the network, and turned back?"
    if interface == "segmenter":
        return _explain_masks(answer, case)
    if interface == "contact_prior" and own.on_line >= PROVEN > own.share:
        return f"{_contact_range(answer)}: is a sigmoid applied twice, or not at all, or are the values rescaled?"
    if interface == "body_estimator" and own.share >= PROVEN:
        return (
            "The pose is right: is it the shape, the orientation, or the place, such as for the focal length of a crop?"
        )
    own_values, true, tolerance = _comparable(interface, answer, case)
    largest = own_values > own_values.max(initial=-np.inf) - tolerance
    if largest.sum() > MAX_LARGEST * len(largest) and (true[largest] > own_values[largest] + tolerance).any():
        return f"{largest.mean():.0%} of it are the largest value, and truly larger: is it clipped at a limit?"
    if own.share >= PROVEN:
        return "A part is wrong and the rest is right: values that overflow, a border, rows or people left out?"
    if share >= PROVEN:
        return "Other photos are right: does it depend on the size, the aspect ratio, the camera or an earlier call?"
    if own_values.size and own_values.std() < 1e-6 < true.std():
        return f"It is {own_values[0]:.3g} everywhere: is the network's answer used?"
    if own.on_line < PROVEN and true.size > 2 and true.std() > 0:
        factor = float(np.cov(own_values, true)[0, 1] / true.var(ddof=1))
        own = Agreement(own.share, own.on_line, factor, float(own_values.mean() - factor * true.mean()))
    return f"It is {_line_in_words(interface, own)} in the mean: a factor, a shift, another order, or resampling?"


def _contact_range(answer: Any) -> str:
    """Return the range of contact probabilities as text."""
    likely = contact_on_embedded(answer).probability
    return f"The order of the vertices is right, with values from {likely.min():.2g} to {likely.max():.2g}"


def _explain_masks(answer: People, case: Case) -> str:
    """Return by how much masks are too large, and on which sides."""
    if len(answer) < len(case.truth.masks):
        return f"{len(answer)} of {len(case.truth.masks)} people are found: is a threshold too high, or are rows lost?"
    texts = [f"{value:+.1f} px {side}" for side, value in zip(SIDES, outward_px(answer, case).mean(0), strict=True)]
    return f"The masks reach {', '.join(texts)}: are they dilated, padded or resampled?"


SIDES = ("left", "up", "right", "down")


def outward_px(answer: People, case: Case) -> FloatArray:
    """Return how much farther (N, 4) px each true person's best mask reaches to the left, up, right and down."""
    found = []
    for true in case.truth.masks:
        own = answer.masks[int(mask_iou(answer.masks, true[None])[:, 0].argmax())]
        axes = [mask.any(axis) for mask in (own, true) for axis in (0, 1)]
        ends = [(at[0], -at[-1]) for at in map(np.flatnonzero, axes)]
        (left, right), (up, down), (true_left, true_right), (true_up, true_down) = ends
        found.append([true_left - left, true_up - up, true_right - right, true_down - down])
    values: FloatArray = np.array(found, np.float64).reshape(-1, 4)
    return values


def agreement(interface: str, answer: Any, case: Case) -> Agreement:
    """Return which share of an output is the truth, or on one line with it."""
    if interface == "segmenter":
        share = _exact_borders(answer, case)
        return Agreement(share, share)
    own, true, tolerance = _comparable(interface, answer, case)
    if not own.size:
        return Agreement(0.0, 0.0)
    if interface == "contact_prior":
        return _contact_agreement(own, true)
    share = float((np.abs(own - true) < tolerance).mean())
    if share >= PROVEN or interface == "inpainter":  # eight bits and flat colours prove no line
        return Agreement(share, share)
    factor, offset, on_line = _line_of_most(own, true, tolerance)
    return Agreement(share, on_line, factor, offset) if on_line > share else Agreement(share, share)


def _comparable(interface: str, answer: Any, case: Case) -> tuple[FloatArray, FloatArray, float]:
    """Return values of an output and the true ones (K,), and the tolerance of rounding, all in one unit."""
    truth, tolerance = case.truth, 1e-4
    with np.errstate(all="ignore"):
        if interface == "metric_depth":
            own, true, tolerance = np.log(answer.depth), np.log(truth.empty_depth), 2e-5
        elif interface == "relative_pointmap":
            z, true = answer.points[..., 2].astype(np.float64), truth.empty_depth.astype(np.float64)
            both = answer.valid & np.isfinite(true)
            own, true = np.log(scale_fitted(z[both], true[both], answer.unknown)), np.log(true[both])
        elif interface == "inpainter":
            own, true, tolerance = answer[case.hole].astype(float), case.empty[case.hole].astype(float), 1.5
        elif interface == "keypoint_detector":
            points, places, seen, _ = comparable_keypoints(answer, truth)
            own, true, tolerance = points[seen], places[seen], 0.02
        elif interface == "body_estimator":
            own, true, tolerance = parameters_of_model(answer).body_pose, truth.parameters.body_pose, 0.002
            own, true = own[np.abs(true) > 0.05], true[np.abs(true) > 0.05]  # what does not bend proves nothing
        elif interface == "hand_estimator":
            shown = answer.confidence > 0
            own, true, tolerance = answer.rotvecs[shown], true_hands(truth)[shown], 0.002
        elif interface == "contact_prior":
            own, true = contact_on_embedded(answer).probability, truth.contact
        else:
            own = true = np.zeros(0)
    own, true = np.asarray(own, np.float64).ravel(), np.asarray(true, np.float64).ravel()
    known = np.isfinite(own) & np.isfinite(true)
    step = 1 if interface == "contact_prior" else max(1, int(known.sum()) // _SAMPLES)
    return own[known][::step], true[known][::step], tolerance


def _contact_agreement(own: FloatArray, true: FloatArray) -> Agreement:
    """Return the agreement of probabilities with contact: its share is that of the vertices in contact."""
    found, touching = own > CONTACT_THRESHOLD, true > 0
    precision = (found & touching).sum() / max(int(found.sum()), 1)
    share = float((found & touching).sum() / max(int(touching.sum()), 1)) if precision > 0.99 else 0.0
    if share < PROVEN and touching.any() and own[touching].min() > own[~touching].max():
        return Agreement(share, 1.0)  # perfect order with another threshold
    return Agreement(share, share)


def _line_of_most(own: FloatArray, true: FloatArray, tolerance: float) -> tuple[float, float, float]:
    """Return factor and offset of the line through two values that most values lie on, and their share."""
    one, other = np.random.default_rng(0).integers(len(true), size=(2, _LINES))
    gaps = true[one] - true[other]
    factors = (own[one] - own[other]) / np.where(gaps == 0, np.nan, gaps)
    telling = (np.abs(gaps) > 20 * tolerance) & (factors > FACTORS[0]) & (factors < FACTORS[1])
    if not telling.any():
        return 1.0, 0.0, 0.0
    factors = factors[telling]
    offsets = own[one[telling]] - factors * true[one[telling]]
    hits = (np.abs(own - offsets[:, None] - factors[:, None] * true) < tolerance).mean(1)
    best = int(hits.argmax())
    return float(factors[best]), float(offsets[best]), float(hits[best])


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
