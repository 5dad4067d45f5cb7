"""Probability that a person is right in pose, place, contact and size, in each of them and in all,
from the values of checks.

The models are logistic. Each of their terms falls with the load of a check: the value over the
limit, so that a worse value never raises a probability. What was not measured costs nothing.
``benchmarks/trust_on_photos.py`` fits the models to the marks of readers, and writes
``trust.json``.

A failed check that contradicts a mark caps its probability and that of all, whatever the others
say.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, TypeAlias

from physic_core.judge.spec import CHECKS
from physic_core.types import MARKS
from physic_core.types.records import in_words, is_usable

if TYPE_CHECKING:
    from physic_core.types import CheckResult

MAX_LOAD = 3.0
"""Load from which a value counts as no worse."""

CAP = 0.5
"""Largest probability with one contradiction; that of two is its square."""

_REASONS = 2  # that are named with what to do, if they fail; others only without failures
_LEAST_LOSS = 0.25  # log odds that a named reason takes away
# What readers found wrong of people without a failed check.
_LOOK = "compare head, trunk, arms in depth and lifted feet with the photo"


ALL = "all"
"""Model of people who are right in all marks."""

TrustModel: TypeAlias = Mapping[str, Any]
"""Fitted model of one mark, or of all: "constant", the log odds of a person whose loads are usual;
"terms", check -> its share in the log odds.

A share has a "slope", the log odds of a load of 1, at most 0; and a "usual" load, whose share is 0:
the median of people who are right.
"""


@dataclass(frozen=True)
class Trust:
    """Degree of trust in a person.

    Attributes:
        probability: that all is right.
        marks: name of :data:`~physic_core.types.MARKS` -> probability that it is right.
        why: sentence that names what lowers the probability most, and what to do.
    """

    probability: float
    marks: Mapping[str, float]
    why: str

    def as_fields(self) -> dict[str, Any]:
        """Return the fields of a :class:`~physic_core.types.Person` that say it."""
        marks = {f"trust_{name}": probability for name, probability in self.marks.items()}
        return {"trust": self.probability, "why": self.why} | marks


@cache
def trust_models() -> Mapping[str, TrustModel]:
    """Return the fitted models of each mark and of :data:`ALL`."""
    text = (files("physic_core.judge") / "trust.json").read_text(encoding="utf-8")
    models: Mapping[str, TrustModel] = json.loads(text)["models"]
    return models


def relative_excess(
    value: float | None, threshold: float, direction: str, unit: str
) -> float | None:
    """Return the load of a check: 1 at the limit, more beyond it, and 0 at best; None without a
    value.

    It is the value over a limit "at most", and the rest to 1 over that of a least share. Of counts
    and of yes and no it is how many are missing, plus 1.
    """
    if value is None:
        return None
    if direction == "at most":
        load = value / threshold if threshold else 1 + value
    elif unit == "share":
        load = (1 - value) / (1 - threshold)
    else:
        load = 1 + threshold - value
    return min(max(load, 0.0), MAX_LOAD)


def log_odds(values: Mapping[str, float | None], model: TrustModel) -> dict[str, float]:
    """Return check -> its share in the log odds that a person is right.

    Args:
        values: check -> value, None where nothing was measured.
        model: fitted.
    """
    shares = {}
    for name, term in model["terms"].items():
        spec = CHECKS[name]
        load = relative_excess(values.get(name), spec.threshold, spec.direction, spec.unit)
        shares[name] = 0.0 if load is None else term["slope"] * (load - term["usual"])
    return shares


def probabilities_of(
    values: Mapping[str, float | None], models: Mapping[str, TrustModel]
) -> dict[str, float]:
    """Return the probability that a person is right, of each mark and of :data:`ALL`, which is at
    most that of the least mark.

    Args:
        values: as of :func:`log_odds`.
        models: fitted, of each mark and of all.
    """
    probabilities: dict[str, float] = {}
    for mark in (*MARKS, ALL):
        odds = models[mark]["constant"] + sum(log_odds(values, models[mark]).values())
        probabilities[mark] = capped_by_contradictions(
            1 / (1 + math.exp(-odds)), len(contradictions(values, mark))
        )
    return probabilities | {ALL: min(probabilities.values())}


def contradictions(values: Mapping[str, float | None], mark: str = ALL) -> list[str]:
    """Return the checks that contradict a mark of a person, or any."""
    return [
        spec.name
        for spec in CHECKS.values()
        if (spec.contradicts if mark == ALL else mark in spec.contradicts)
        and spec.compare(values.get(spec.name)).failed
    ]


def person_trust(checks: Sequence[CheckResult], person: int) -> Trust:
    """Return how far a person is to be trusted, with the reasons.

    Every failed check of the person is named, and those that pass but lower the trust much.

    Args:
        checks: of the photo and of all people.
        person: whose.
    """
    person_checks = {check.name: check for check in checks if check.person in (None, person)}
    values = {name: check.value for name, check in person_checks.items()}
    probabilities = probabilities_of(values, trust_models())
    shares = log_odds(values, trust_models()[ALL])
    named = contradictions(values)
    named += [
        name
        for name, check in person_checks.items()
        if check.failed and check.person == person and name not in named
    ]
    named.sort(key=lambda name: (not CHECKS[name].contradicts, shares.get(name, 0.0)))
    passing = sorted(
        (name for name in shares if name in person_checks and name not in named),
        key=shares.__getitem__,
    )
    lowering = [name for name in passing if shares[name] <= -_LEAST_LOSS]
    why = [part for name in named[:_REASONS] for part in _reason_of_check(person_checks[name])]
    why += [str(person_checks[name]) for name in named[_REASONS:]]
    left = max(0, _REASONS - len(named))
    why += [part for name in lowering[:left] for part in _reason_of_check(person_checks[name])]
    probability = probabilities.pop(ALL)
    doubtful = [name for name, chance in probabilities.items() if not is_usable(chance)]
    if doubtful and not named:
        why.append(f"no check fails, but {in_words(doubtful)} stay doubtful: {_LOOK}")
    text = " ".join(f"{one[0].upper()}{one[1:]}." for one in why)
    return Trust(probability, probabilities, text)


def no_trust(checks: Sequence[CheckResult], person: int) -> Trust:
    """Return the trust in a person without a body, with the contradictions that say why."""
    return replace(person_trust(checks, person), probability=0.0, marks=dict.fromkeys(MARKS, 0.0))


def capped_by_contradictions(probability: float, contradictions: int) -> float:
    """Return a probability, at most that which a number of contradictions leaves."""
    return min(probability, CAP**contradictions) if contradictions else probability


def _reason_of_check(check: CheckResult) -> list[str]:
    """Return sentences on a check that lowers a probability: its value, and what to do."""
    if check.value is None:
        return [f"{check.title}, {check.message}"]
    if check.failed:
        return [str(check), check.message] if check.message else [str(check)]
    advice = CHECKS[check.name].advice
    return [str(check), f"it passes, but lowers the marks: {advice}"] if advice else [str(check)]
