"""Checks of ``missing`` and ``fingerprint``, which are called before a backend is loaded."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from physic_core.discovery.backends import missing_requirements
from physic_core.discovery.error_text import describe_error
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, expect
from physic_testing.conformance.network_and_memory import no_network

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MAX_SECONDS = 0.25
"""Maximum CPU time of a call, s: every run calls ``missing`` and ``fingerprint`` of each selected
backend.
"""


def check_missing_is_fast_and_repeatable(subject: BackendUnderTest) -> None:
    """`missing` is fast, reads no weights, and returns the same list in each call."""
    backend = subject.new_instance()
    first, again, seconds = _call_timed(subject, "missing()", lambda: missing_requirements(backend))
    expect(
        first == again,
        "missing() to return the same list in both calls",
        f"{first!r}, then {again!r}",
    )
    _expect_quick("missing()", seconds, "Test whether the files exist; open them in load().")


def check_fingerprint_works_before_load(subject: BackendUnderTest) -> None:
    """`fingerprint` returns, before `load` and offline, the same str for the same weights; it is
    fast.
    """
    backend = subject.new_instance()
    other = subject.new_instance()
    first, again, seconds = _call_timed(subject, "fingerprint()", backend.fingerprint)
    for returned in (first, again):
        expect(
            isinstance(returned, str),
            "fingerprint() to return a str, empty without weights",
            repr(returned),
        )
    expect(
        first == again == (further := _call_timed(subject, "fingerprint()", other.fingerprint)[0]),
        "the same fingerprint() each time, as long as the weights are the same",
        f"{first!r}, then {again!r}, and {further!r} of another backend with the same options",
        "If the fingerprint changes between calls, cached results are never used.",
    )
    _expect_quick(
        "fingerprint()",
        seconds,
        "Use `physic_core.weights.fingerprint`, which reads a file again only if it changes.",
    )


def _call_timed(
    subject: BackendUnderTest, name: str, ask: Callable[[], Any]
) -> tuple[Any, Any, float]:
    """Call a function two or three times; return the first two results and the shortest CPU
    time.
    """
    answers = []
    best = float("inf")
    with no_network() as places:
        for _ in range(3):  # the first call may import modules
            start = time.process_time()
            try:
                answers.append(ask())
            except Exception as error:
                raise CheckFailed(
                    f"{name} to work before load()", describe_error(error, subject.kind)
                ) from error
            best = min(best, time.process_time() - start)
            if len(answers) > 1 and best < MAX_SECONDS:
                break
    expect(
        not places, f"{name} to use no network", f"it requests {', '.join(dict.fromkeys(places))}"
    )
    return answers[0], answers[1], best


def _expect_quick(name: str, seconds: float, hint: str) -> None:
    """Raise CheckFailed if a call takes too much CPU time."""
    expect(
        seconds < MAX_SECONDS,
        f"{name} in less than {MAX_SECONDS} s of processor time",
        f"{seconds:.2f} s, each time",
        hint,
    )


_BACKEND = "physic_core.interfaces.Backend"
_CONSTRUCTED = ("constructs_with_its_defaults",)
CHECKS: tuple[Check, ...] = (
    Check(
        check_missing_is_fast_and_repeatable,
        f"{_BACKEND}.missing",
        after=(*_CONSTRUCTED, "loads_or_reports_what_is_missing"),
    ),
    Check(check_fingerprint_works_before_load, f"{_BACKEND}.fingerprint", after=_CONSTRUCTED),
)
"""Checks of the calls that every run makes before it loads a backend."""
