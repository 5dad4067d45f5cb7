"""Checks that row i of an output is that of person i, whoever else is in the photo."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BodyModelError
from physic_testing.conformance.accuracy import main_error
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.field_comparison import describe_difference
from physic_testing.conformance.requests import infer_arguments

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

MAX_RATIO = 0.5
"""Share of the error that the rows in the right order leave at most."""


def check_rows_follow_the_people(subject: BackendUnderTest) -> None:
    """Row i belongs to person i: reversed for reversed people, and closer to the truth than in
    another order.
    """
    answer = subject.result("several people")
    case = subject.case("several people")
    count = len(case.people)
    own = _error(subject.interface, answer, case)
    for order in (np.arange(count)[::-1], *(np.roll(np.arange(count), k) for k in range(1, count))):
        other = _error(subject.interface, _reordered(answer, order, count), case)
        expect(
            not other < MAX_RATIO * own,
            "row i for person i",
            f"an error of {own:.3g}, but of {other:.3g} with the rows in the order "
            f"{order.tolist()}",
            "Do not sort people by size or score.",
        )
    turned = tuple(
        _reordered(a, np.arange(count)[::-1], count)
        for a in infer_arguments(subject.interface, case)
    )
    again = subject.call("output for the same people in reverse order", case, turned)
    first = _rows(answer, count)
    second = _rows(again, count)
    apart = np.abs(first[:, None] - second[None]).mean(axis=2)
    if not apart.any():
        raise CheckSkipped("its output is the same for all people")
    kept = float(np.trace(apart))
    swapped = float(np.trace(apart[::-1]))
    expect(
        swapped < 0.5 * kept,
        "row i for person i: reversed rows for reversed people",
        "rows in another order",
        "Do not sort people by size or score.",
    )


def check_rows_do_not_depend_on_other_people(subject: BackendUnderTest) -> None:
    """A person alone gets the row that the person has among others."""
    answer = subject.result("several people")
    case = subject.case("several people")
    count = len(case.people)
    changes = {}
    for i in range(count):
        alone = replace(
            _reordered(replace(case, world=None), np.array([i]), count), world=case.world
        )
        own = subject.call(
            "output for one of several people", alone, infer_arguments(subject.interface, alone)
        )
        if change := describe_difference(_reordered(answer, np.array([i]), count), own):
            changes[i] = change
    expect(
        not changes,
        "the same row for a person alone as among others",
        f"other rows for {len(changes)} of {count} people, such as "
        f"{next(iter(changes.values()), '')}",
        "Is a layer in training mode (call eval()), or are values normalised over people? Dynamic "
        "ranges of "
        "quantised networks are for all rows of a batch: show it one person at a time.",
    )


def _error(interface: str, answer: Any, case: Case) -> float:
    """Return the error of the answer, lower is better; NaN where worlds have no ground truth for
    it.
    """
    try:
        return main_error(interface, answer, case)
    except (BodyModelError, CheckSkipped):
        return float("nan")


def _reordered(thing: Any, order: IntArray, count: int) -> Any:
    """Take rows of all arrays that have one row for each of ``count`` people."""
    if isinstance(thing, np.ndarray):
        return thing[order].copy() if thing.ndim and len(thing) == count else thing
    if is_dataclass(thing) and not isinstance(thing, type):
        return replace(
            thing,
            **{f.name: _reordered(getattr(thing, f.name), order, count) for f in fields(thing)},
        )
    return thing


def _rows(answer: Any, count: int) -> FloatArray:
    """Return the values of each person (N, M), each array scaled to at most 1."""
    found: list[FloatArray] = []

    def gather(thing: Any) -> None:
        if isinstance(thing, np.ndarray) and thing.ndim and len(thing) == count:
            flat = np.nan_to_num(thing.astype(np.float64).reshape(count, -1))
            found.append(flat / max(float(np.abs(flat).max(initial=0)), 1e-9))
        elif is_dataclass(thing) and not isinstance(thing, type):
            for field in fields(thing):
                gather(getattr(thing, field.name))

    gather(answer)
    return np.concatenate(found, axis=1)


ROW_CHECKS: tuple[Check, ...] = (
    Check(check_rows_follow_the_people, "physic_core.interfaces"),
    Check(
        check_rows_do_not_depend_on_other_people,
        "physic_core.interfaces",
        after=("rows_follow_the_people",),
        unless=frozenset({"stochastic"}),
        warns=True,
    ),
)
"""Checks of interfaces that receive people."""
