"""How outputs of a PersonObserver are compared: what people do and touch, where the faces look, and
the sides in a mirrored photo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body import angle_deg
from physic_core.types import CHOICES, PROBABILITIES, SIDES, TOUCH_PARTS, mirrored_order
from physic_testing.conformance import truth as worlds
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.known_mistakes import (
    MIN_UNITS,
    Group,
    KnownMistake,
    Table,
    check_stated_errors_hold,
    reordered,
    times,
    values_of,
)
from physic_testing.conformance.output_checks import COLOURS, ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.requests import mirrored

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Observations
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MIRROR_TOLERANCE = 0.1
"""Difference of probabilities that may be an error."""

MAX_BRIER = {"posture": 0.45}
MAX_OTHER_BRIER = 0.6
"""Mean squared error of probabilities from which on they mislead: of 0.5 for all it is 0.25. People
of worlds have no faces: the embedded observer has up to 0.33 and 0.51.
"""

ALIKE = 0.05
MAX_OF_ALIKE = 1.2
"""Range of probabilities that are the same of everybody, and the most of their error over that of
equal ones: they are evidence of nothing.
"""

_OWN_LEFT = "Are sides those of the picture? Left is the person's own."
_ORDER = "The order is that of physic_core.types.TOUCH_PARTS."
_ANSWERS = "The order of the answers is that of physic_core.types.TOUCHED."
_AXES = "x points right, y down, z away from the camera: (0, 0, -1) looks at it."


def _values(answer: Observations, case: Case) -> tuple[Values, Truth]:
    """Return touch, faces, and what each probability is evidence of, (N, n) in [0, 1]."""
    truth = worlds.true_observations(case.truth)
    head = answer.head.astype(float)
    values: Values = {
        "head": head,
        "touch": answer.touch.astype(float),
        "sigmas": angle_deg(head, truth["head"]) / answer.head_sigma,
    }
    for name in PROBABILITIES:
        odds = np.exp(answer.evidence(name).astype(float))
        alone = odds / odds.sum(-1, keepdims=True) if name in CHOICES else odds / (1 + odds)
        values[f"evidence of {name}"] = np.where(np.isfinite(getattr(answer, name)), alone, np.nan)
    return values, truth


def _errors(values: Values, truth: Truth) -> dict[str, Any]:
    return {"Brier": (values["touch"] - truth["touch"]) ** 2}


def check_probabilities_agree_with_the_worlds(subject: BackendUnderTest) -> None:
    """Without their shares, probabilities do not mislead; those that are the same of everybody are
    evidence of nothing.
    """
    evidence = values_of(subject)
    for name in PROBABILITIES:
        answered = np.concatenate([values[f"evidence of {name}"] for values, _ in evidence])
        true = np.concatenate([truth[name] for _, truth in evidence])
        off = [(answered - t)[(true == t) & np.isfinite(answered)] ** 2 for t in (0, 1)]
        error = float(np.mean([part.mean() for part in off if len(part) >= MIN_UNITS] or [0]))
        limit = MAX_BRIER.get(name, MAX_OTHER_BRIER)
        if error and np.ptp(answered[np.isfinite(answered)]) < ALIKE:
            answers = answered.shape[-1] if name in CHOICES else 2
            limit = MAX_OF_ALIKE * (1 - 1 / answers) / answers
            error = float(np.mean(np.concatenate(off)))
        expect(
            not error >= limit,
            f"`{name}`, without `{name}_share`, of what people do",
            f"a mean squared error of {error:.2f}, which has to be below {limit:.2f}",
            "Is it inverted, in another order, or the same of everybody but not the share?",
        )


def check_mirrored_photo_exchanges_sides(subject: BackendUnderTest) -> None:
    """For a mirrored photo, what is said of the left side is said of the right one."""
    distances = []
    for case, answer in subject.evidence():
        wanted = "valid output for a mirrored photo, or a PhysicError"
        mirrored_answer = subject.call(
            wanted, case, mirrored(subject.request(case)), may_refuse=True
        )
        if mirrored_answer is not None:
            sides, other = _sides(answer), _sides(mirrored_answer)
            differ = np.abs(sides - sides[:, ::-1]) > MIRROR_TOLERANCE  # False for NaN
            apart = np.stack([np.abs(sides - other), np.abs(sides - other[:, ::-1])])[:, differ]
            distances.append(apart[:, np.isfinite(apart).all(0)])
    same, exchanged = (np.concatenate(distances, 1) if distances else np.zeros((2, 0))).mean(1)
    if np.isnan(same):
        raise CheckSkipped("of no mirrored photo it tells the sides of a person apart")
    expect(
        bool(exchanged <= same + MIRROR_TOLERANCE),
        "the sides exchanged in a mirrored photo",
        f"a mean difference of {exchanged:.2f} with the sides exchanged, of {same:.2f} without",
        "Does the place of a limb follow its keypoint? Is a mirrored crop mirrored back?",
    )


def _sides(answer: Observations) -> FloatArray:
    """Return what is said of the left and the right side (N, 2, 20), in [0, 1]."""
    rows = [[i for i, part in enumerate(TOUCH_PARTS) if part.startswith(side)] for side in SIDES]
    both = answer.touch[:, rows].astype(np.float64)
    return both.reshape(len(both), 2, -1)


TABLE = Table(
    _values,
    _errors,
    (
        WITHOUT_PEOPLE,
        Check(check_mirrored_photo_exchanges_sides, unless=BLIND),
        Check(
            check_probabilities_agree_with_the_worlds,
            after=("touch_is_that_of_the_parts",),
            unless=BLIND,
        ),
        Check(check_stated_errors_hold, after=("head_looks_out_of_the_face",), unless=BLIND),
        *ROWS,
        COLOURS,
    ),
    (
        Group(
            "touch_is_that_of_the_parts",
            "probabilities of what each part touches, left ones on the person's own left",
            "touch",
            "of a probability",
            (
                KnownMistake("inverted", lambda p, _: (1 - p) / 4, "1 is touch."),
                KnownMistake(
                    "with left and right exchanged",
                    reordered(mirrored_order(TOUCH_PARTS)),
                    _OWN_LEFT,
                ),
                KnownMistake("with hands for feet", reordered([2, 3, 0, 1, *range(4, 10)]), _ORDER),
                KnownMistake(
                    "with answers in another order", reordered([4, 0, 1, 2, 3], axis=2), _ANSWERS
                ),
            ),
        ),
        Group(
            "head_looks_out_of_the_face",
            "unit vectors in which the faces look, in the photo's camera frame",
            "head",
            "",
            tuple(
                KnownMistake(words, times(*factors), _AXES)
                for words, factors in {
                    "into the face": (-1, -1, -1),
                    "with x to the left": (-1, 1, 1),
                    "with y up": (1, -1, 1),
                    "with z to the camera": (1, 1, -1),
                }.items()
            ),
        ),
    ),
)
