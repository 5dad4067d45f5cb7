"""Exceptions with which a check fails, warns or is skipped."""

from __future__ import annotations

from typing import Any, Literal

from physic_core.interfaces.comparison import describe_difference


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


def expect_or_warn(condition: bool, expected: str, got: str, hint: str = "") -> None:
    """Raise CheckWarned with the other arguments unless the condition is true."""
    if not condition:
        raise CheckWarned(expected, got, hint)


def expect_same(expected: str, first: Any, second: Any, hint: str = "") -> None:
    """Raise CheckFailed with the difference of two outputs, if there is one."""
    differ = describe_difference(first, second)
    expect(not differ, expected, differ, hint)
