"""One conformance check, and the exceptions with which it fails, warns or is skipped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

BLIND = frozenset({"ignores_image"})
"""Capability of backends for which checks of bias are skipped."""


class CheckFailed(AssertionError):
    """Exception of a failed check: the backend violates the contract of its interface.

    Args:
        expected: what the contract requires, with units.
        got: what the backend returned or did, with units.
        hint: a likely cause; empty where none suggests itself.
    """

    outcome: Literal["failed", "warned"] = "failed"

    def __init__(self, expected: str, got: str, hint: str = "") -> None:
        self.expected = expected
        self.got = got
        self.hint = hint
        super().__init__(f"expected {expected}; got {got}{f'. {hint}' if hint else ''}")


class CheckWarned(CheckFailed):
    """Exception of a check that only warns: the contract does not forbid what the backend does."""

    outcome: Literal["failed", "warned"] = "warned"


class CheckSkipped(Exception):
    """Exception of a skipped check; the message gives the reason."""


def expect(condition: bool, expected: str, got: str, hint: str = "") -> None:
    """Raise CheckFailed with the other arguments unless the condition is true."""
    if not condition:
        raise CheckFailed(expected, got, hint)


def warn_unless(condition: bool, expected: str, got: str, hint: str = "") -> None:
    """Raise CheckWarned with the other arguments unless the condition is true."""
    if not condition:
        raise CheckWarned(expected, got, hint)


@dataclass(frozen=True)
class Check:
    """One conformance check: its function and its conditions.

    Attributes:
        function: raises CheckFailed if the backend violates the contract, CheckSkipped if this
            cannot be tested. Its name without "check_" is the name of the check, and the first
            line of its docstring is the summary.
        after: names of checks that must not have failed, because this check would fail for the same
            reason.
        unless: capabilities of a backend for which the check is skipped.
        only_with: capabilities that a backend must have for the check to run.
        read: module or class that documents the requirement, for the message of a failure; by
            default the class of the interface.
    """

    function: Callable[[BackendUnderTest], None]
    after: tuple[str, ...] = ()
    unless: frozenset[str] = frozenset()
    only_with: frozenset[str] = frozenset()
    read: str = ""

    @property
    def name(self) -> str:
        """Name of the check."""
        return self.function.__name__.removeprefix("check_")

    @property
    def summary(self) -> str:
        """First line of the function's docstring."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]
