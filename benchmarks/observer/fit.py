"""Fit each question to labelled people, and score it on people who took no part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import nan

import numpy as np
from numpy.typing import NDArray

from benchmarks.truth.measures import probability_scores
from benchmarks.truth.sets import Sample
from physic_core.types import TOUCHED
from physic_testing.metrics.intervals import draw_counts, percentile_interval

from .labels import Truth, answers, repository_of
from .regression import (
    Array,
    Examples,
    calibrated,
    calibration,
    fit_logistic,
    left_out_logits,
    logits_of,
    probabilities,
)

RIDGE = 100.0
RIDGES = {"hand": 200.0}
"""Ridge of a question, and of those for which another one has less log loss."""

FRAME_WEIGHT = 0.5
"""Weight of a frame of a film: the frames of a film are not independent."""

APART = "films apart"
"""Set of pictures that no number is fitted to."""

DRAWS = 500
"""Draws of an interval."""

SCORED = {1: ("",), 3: ("world", "own body"), 5: TOUCHED[:-1]}
"""Number of answers of a question -> names of those that are scored each."""

FALSE_SHARE = 0.03
"""Share of "no" that a threshold takes for "yes", at which a recall is printed."""


@dataclass(frozen=True)
class LabelledPerson:
    """A labelled person and the tokens that answer questions of the person.

    Attributes:
        photo: of the person.
        truth: labels.
        tokens: question -> (sides, C); NaN where the photo does not show it.
    """

    photo: Sample
    truth: Truth
    tokens: Mapping[str, Array]


@dataclass(frozen=True)
class Question:
    """Examples of one question, and where they are from.

    Attributes:
        name: of the question.
        examples: whose groups are the photos or films.
        sets: (n,) set of each.
        repositories: (n,) repository of each.
        ridge: weight of half the squared weights of standardised tokens.
    """

    name: str
    examples: Examples
    sets: NDArray[np.str_]
    repositories: NDArray[np.str_]
    ridge: float = RIDGE

    def of(self, rows: NDArray[np.bool_]) -> Question:
        """Return the examples of some rows, (n,) bool."""
        return replace(
            self,
            examples=self.examples.take(rows),
            sets=self.sets[rows],
            repositories=self.repositories[rows],
        )

    @property
    def fit(self) -> Callable[[Examples], Array]:
        """The regression of the question's answers."""
        return partial(fit_logistic, ridge=self.ridge)

    @property
    def by_repository(self) -> Examples:
        """The examples, of which whole repositories are left out at once."""
        of = self.examples
        return Examples(of.x, of.y, of.weight, self.repositories.tolist())


def question_of(name: str, people: Sequence[LabelledPerson]) -> Question:
    """Return the examples of one question: labelled, and in the picture."""
    rows = [
        (x, y, person.photo)
        for person in people
        for x, y in zip(person.tokens[name], answers(name, person.truth), strict=True)
        if np.isfinite(x).all() and np.isfinite(y).all()
    ]
    photos = [photo for *_, photo in rows]
    weight = [FRAME_WEIGHT if photo.set.startswith("films") else 1.0 for photo in photos]
    examples = Examples(
        np.array([x for x, *_ in rows]),
        np.array([y for _, y, _ in rows]),
        np.array(weight),
        [photo.group for photo in photos],
    )
    sets = np.array([photo.set for photo in photos])
    repositories = np.array([repository_of(photo) for photo in photos])
    return Question(name, examples, sets, repositories, RIDGES.get(name, RIDGE))


def fitted(question: Question) -> NDArray[np.float32]:
    """Return the numbers of a question (K, C + 2): weights and constant, calibrated on people whose
    repository took no part, and the share of "yes".
    """
    of = question.examples
    numbers = calibrated(question.fit(of), calibration_of(question))
    share = (of.weight @ of.y) / of.weight.sum()
    return np.column_stack([numbers, share]).astype(np.float32)


def calibration_of(question: Question) -> tuple[float, float]:
    """Return factor and offset that calibrate logits, from people whose repository was left out."""
    of = question.by_repository
    return calibration(left_out_logits(of, question.fit), of)


def figures(question: Question) -> dict[str, str]:
    """Return the scores of a question on the given photos with repositories left out, and on each
    other set by a fit to the given photos alone.
    """
    fit = question.fit
    given = question.of(question.sets == "given")
    factor, offset = calibration_of(given)
    numbers = fit(given.examples)
    logits = {"repositories left out": (left_out_logits(given.by_repository, fit), given.examples)}
    for other in sorted({*question.sets.tolist()} - {"given"}):
        apart = question.of(question.sets == other).examples
        logits[other] = logits_of(numbers, apart.x), apart
    return {
        name: _scores(probabilities(values * factor + offset), of)
        for name, (values, of) in logits.items()
    }


def _scores(p: Array, of: Examples) -> str:
    """Return number of examples, those of "yes", and scores with intervals over the groups."""
    _, group = np.unique(np.array(of.groups), return_inverse=True)
    rows = [np.flatnonzero(group == g) for g in range(group.max() + 1)]
    drawn: dict[str, list[float]] = {}
    for counts in draw_counts(len(rows), DRAWS):
        take = np.concatenate(
            [np.tile(of_picture, int(n)) for of_picture, n in zip(rows, counts, strict=True)]
        )
        for name, value in _of_cases(p[take], of.y[take]).items():
            drawn.setdefault(name, []).append(value)
    texts = []
    for name, value in _of_cases(p, of.y).items():
        low, high = percentile_interval(drawn[name])
        texts.append(f"{name} {value:.3f} [{low:.3f}, {high:.3f}]")
    yes = of.y.sum(0).round().astype(int).tolist()
    return f"{len(p)} ({', '.join(map(str, yes))}): " + ", ".join(texts)


def _of_cases(p: Array, y: Array) -> dict[str, float]:
    if (answers := SCORED.get(y.shape[1])) is not None:
        return {
            f"{answer} {name}".lstrip(): value
            for j, answer in enumerate(answers)
            for name, value in _of_answer(p[:, j], y[:, j] > 0.5).items()
        }
    right = y[np.arange(len(y)), p.argmax(1)] > 0
    return {
        "right": float(right.mean()),
        "log loss": float(-(y * np.log(p + 1e-12)).sum(1).mean()),
    }


def _of_answer(p: Array, y: NDArray[np.bool_]) -> dict[str, float]:
    scores = probability_scores(p.tolist(), y.tolist())
    recall = (
        float((p[y] > np.quantile(p[~y], 1 - FALSE_SHARE)).mean()) if y.any() > y.all() else nan
    )
    named = {name: scores[name] for name in ("auc", "brier", "constant", "balanced")}
    is_likely = p >= 0.5
    right = float(y[is_likely].mean()) if is_likely.any() else nan
    return named | {
        f"recall at {FALSE_SHARE:.0%} false": recall,
        "recall": float(is_likely[y].mean()) if y.any() else nan,
        "precision": right,
    }
