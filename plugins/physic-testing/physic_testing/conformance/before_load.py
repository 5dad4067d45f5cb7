"""Checks of what a backend says of itself before it is loaded: what it lacks, and what else its answers depend on."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import describe
from physic_core.discovery.readiness import missing_requirements
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.guard import no_network

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["SAYINGS"]

MOST_SECONDS = 0.25
"""Processor time that an answer may take: every chosen backend is asked in every run, before anything else."""


def check_missing_is_fast_and_repeatable(subject: Subject) -> None:
    """`missing` reads no weights, and returns the same when it is called again."""
    backend = _fresh(subject)
    first, again, seconds = _asked(subject, "missing()", lambda: missing_requirements(backend))
    expect(first == again, "missing() to say the same twice", f"{first!r}, then {again!r}")
    _expect_quick("missing()", seconds, "Look whether files are there; open them in load().")


def check_fingerprint_works_before_load(subject: Subject) -> None:
    """`fingerprint` returns a text fast, offline and before `load`, and the same text for the same weights."""
    backend, other = _fresh(subject), _fresh(subject)
    first, again, seconds = _asked(subject, "fingerprint()", backend.fingerprint)
    for told in (first, again):
        expect(isinstance(told, str), "fingerprint() to return a text, empty where there is nothing to say", repr(told))
    expect(
        first == again == (further := _asked(subject, "fingerprint()", other.fingerprint)[0]),
        "the same fingerprint() each time, as long as the weights are the same",
        f"{first!r}, then {again!r}, and {further!r} of another backend with the same options",
        "With a text that changes, no answer is ever found in the cache.",
    )
    _expect_quick("fingerprint()", seconds, "Names, sizes and times of files tell enough; physic_core.weights does it.")


def _asked(subject: Subject, name: str, ask: Callable[[], Any]) -> tuple[Any, Any, float]:
    """Two answers, and the processor time of the quicker of up to three."""
    answers, best = [], float("inf")
    with no_network() as places:
        for _ in range(3):  # the first one may import modules
            start = time.process_time()
            try:
                answers.append(ask())
            except Exception as error:
                raise CheckFailed(f"{name} to answer before load()", describe(error, subject.kind)) from error
            best = min(best, time.process_time() - start)
            if len(answers) > 1 and best < MOST_SECONDS:
                break
    expect(not places, f"{name} to use no network", f"it asks for {', '.join(dict.fromkeys(places))}")
    return answers[0], answers[1], best


def _expect_quick(name: str, seconds: float, hint: str) -> None:
    expect(
        seconds < MOST_SECONDS,
        f"{name} in less than {MOST_SECONDS} s of processor time",
        f"{seconds:.2f} s, each time",
        hint,
    )


def _fresh(subject: Subject) -> Any:
    try:
        return subject.construct()
    except Exception as error:
        raise CheckSkipped("it cannot be constructed: see 'constructs_with_its_defaults'") from error


_BACKEND = "physic_core.interfaces.Backend"
_CONSTRUCTED = ("constructs_with_its_defaults",)
SAYINGS: tuple[Check, ...] = (
    Check(
        check_missing_is_fast_and_repeatable,
        f"{_BACKEND}.missing",
        after=(*_CONSTRUCTED, "loads_or_reports_what_is_missing"),
    ),
    Check(check_fingerprint_works_before_load, f"{_BACKEND}.fingerprint", after=_CONSTRUCTED),
)
"""Both are asked in every run, of every backend."""
