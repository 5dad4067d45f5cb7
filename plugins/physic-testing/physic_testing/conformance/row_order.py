"""Check that the output rows are in the order of the input people."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.requests import infer_arguments

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["check_rows_follow_the_people"]


def check_rows_follow_the_people(subject: BackendUnderTest) -> None:
    """Row i belongs to person i: if the input people are reversed, the output rows are reversed."""
    answer, case = subject.result("several people"), subject.case("several people")
    count = len(case.people)
    turned = tuple(_reversed(a, count) for a in infer_arguments(subject.interface, case))
    try:
        again = subject.infer(subject.loaded(case), case, turned)
    except Exception as error:
        raise CheckFailed("output for the same people in reverse order", describe_error(error, subject.kind)) from error
    first, second = _rows(answer, count), _rows(again, count)
    apart = np.abs(first[:, None] - second[None]).mean(axis=2)
    if not apart.any():
        raise CheckSkipped("its output is the same for all people")
    kept, swapped = float(np.trace(apart)), float(np.trace(apart[::-1]))
    expect(
        swapped < 0.5 * kept,
        "row i for person i: reversed rows for reversed people",
        "rows in another order",
        "Do not sort people by size or score.",
    )


def _reversed(thing: Any, count: int) -> Any:
    """Reverse the rows of all arrays that have one row per person."""
    if isinstance(thing, np.ndarray):
        return thing[::-1].copy() if thing.ndim and len(thing) == count else thing
    if is_dataclass(thing) and not isinstance(thing, type):
        return replace(thing, **{f.name: _reversed(getattr(thing, f.name), count) for f in fields(thing)})
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
