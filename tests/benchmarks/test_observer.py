"""The fit of the observer of people, on made-up tokens and labels."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.observer.fit import LabelledPerson, fitted, question_of
from benchmarks.observer.labels import agreed, answers
from benchmarks.observer.regression import (
    Examples,
    calibrated,
    calibration,
    fit_logistic,
    folds_of,
    left_out_logits,
    logits_of,
    probabilities,
)
from benchmarks.truth.sets import Sample

fit = partial(fit_logistic, ridge=1.0)


def made_up(n, seed=0):
    """Examples whose first two numbers tell the answer, of groups of four."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 6)) * [1, 2, 1, 1, 5, 1] + 3
    p = probabilities(2 * (x[:, :1] - 3) - (x[:, 1:2] - 3))
    return Examples(x, (rng.random((n, 1)) < p) * 1.0, np.ones(n), [f"{i // 4}" for i in range(n)])


def test_weights_of_known_odds_are_found_again():
    numbers = fit(made_up(4000))
    np.testing.assert_allclose(numbers[0], [2, -1, 0, 0, 0, 0, -3], atol=0.35)


def test_a_repeated_fit_has_the_same_bits():
    np.testing.assert_array_equal(fit(made_up(200)), fit(made_up(200)))


def test_classes_are_told_apart():
    rng = np.random.default_rng(1)
    which = rng.integers(0, 3, 300)
    x = rng.normal(size=(300, 4)) + 4 * np.eye(4)[which]
    of = Examples(x, np.eye(3)[which], np.ones(300), [str(i) for i in range(300)])
    p = probabilities(logits_of(fit(of), x))
    np.testing.assert_allclose(p.sum(1), 1)
    assert (p.argmax(1) == which).mean() > 0.95


def test_a_group_is_left_out_at_once():
    of = made_up(200)
    folds = folds_of(of.groups, 10)
    assert {len(set(folds[i : i + 4])) for i in range(0, 200, 4)} == {1}
    seen = []

    def recorded(some):
        seen.append({*some.groups})
        return fit(some)

    logits = left_out_logits(of, recorded)
    assert np.isfinite(logits).all()
    assert all(len(groups) == 45 for groups in seen)


def test_calibration_widens_what_is_too_sure():
    of = made_up(400)
    factor, offset = calibration(5 * logits_of(fit(of), of.x) + 4, of)
    assert 0.1 < factor < 0.4
    numbers = calibrated(fit(of) * 5 + np.eye(7)[6] * 4, (factor, offset))
    p = probabilities(logits_of(numbers, of.x))
    assert abs((p - of.y).mean()) < 0.01


@pytest.mark.parametrize(
    ("question", "truth", "expected"),
    [
        ("foot", {"parts": {"left_foot": "floor", "right_foot": "none"}}, [[1], [0]]),
        (
            "hand",
            {"parts": {"left_hand": "wall", "right_hand": None}},
            [[1, 0, 0, 0, 0], [np.nan] * 5],
        ),
        ("seat", {"parts": {"seat": "seat"}}, [[1]]),
        ("forearm", {"parts": {"left_forearm": "object"}}, [[0, 0, 1], [np.nan] * 3]),
        ("on_floor", {"parts": {"left_foot": "floor", "right_foot": "support"}}, [[1], [0]]),
        ("posture", {"posture": ["sit", "ride"]}, [[0, 0, 0, 0.5, 0, 0, 0, 0, 0.5]]),
        ("posture", {"posture": "other"}, [[np.nan] * 9]),
    ],
)
def test_labels_answer_questions(question, truth, expected):
    np.testing.assert_array_equal(answers(question, truth), expected)


def test_what_readers_differ_about_is_left_out():
    def person(box, foot, posture, child):
        return {
            "box": box,
            "posture": posture,
            "child": child,
            "parts": {"left_foot": foot, "seat": "none"},
        }

    box = [0, 0, 10, 20]
    first = {"a": [person(box, "floor", "stand", True), person([50, 0, 60, 20], None, "sit", None)]}
    second = {"a": [person([0, 0, 10, 19], "none", "walk", True)]}
    [one] = agreed([first, second])["a"]
    assert one["parts"] == {"left_foot": None, "seat": "none"}
    assert one["posture"] == ["stand", "walk"]
    assert one["child"] is True
    assert agreed([first, first])["a"][0]["parts"]["left_foot"] == "floor"


def test_a_question_is_fitted_to_what_is_labelled_and_seen():
    rng = np.random.default_rng(2)
    people = []
    for i in range(60):
        touches = i % 3 > 0
        tokens = rng.normal(size=(2, 5)) + 3 * touches
        tokens[1, i % 2 :] = np.nan
        labels = {"parts": {"left_foot": "floor" if touches else "none", "right_foot": "none"}}
        photo = Sample("given", f"{'ab'[i % 2]}__{i}", f"{i}", Path())
        people.append(LabelledPerson(photo, labels, {"foot": tokens}))
    question = question_of("foot", people)
    assert len(question.examples.x) == 60
    numbers = fitted(replace(question, ridge=1.0))
    assert numbers.shape == (1, 7)
    assert numbers[0, -1] == pytest.approx(2 / 3)
