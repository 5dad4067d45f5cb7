"""Exceptions with which a check fails or is skipped."""

from __future__ import annotations


class CheckFailed(AssertionError):
    """Exception of a failed check: the backend violates the contract of its interface.

    Args:
        expected: what the contract requires, with units.
        got: what the backend returned or did, with units.
        hint: a likely cause; empty where none suggests itself.
    """

    def __init__(self, expected: str, got: str, hint: str = "") -> None:
        self.expected = expected
        self.got = got
        self.hint = hint
        super().__init__(f"expected {expected}; got {got}{f'. {hint}' if hint else ''}")


class CheckSkipped(Exception):
    """Exception of a skipped check; the message gives the reason."""


def expect(condition: bool, expected: str, got: str, hint: str = "") -> None:
    """Raise CheckFailed unless the condition is true.

    Raises:
        CheckFailed: with the other arguments.
    """
    if not condition:
        raise CheckFailed(expected, got, hint)
