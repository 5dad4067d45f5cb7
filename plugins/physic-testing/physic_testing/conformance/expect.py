"""How a check speaks: what was expected, what came, what it may be, and where to read more."""

from __future__ import annotations

__all__ = ["NotJudged", "NotMet", "expect"]


class NotMet(AssertionError):
    """A backend does not do what its interface promises.

    Args:
        expected: what the contract asks, with units.
        got: what came, with units.
        hint: what it may be, in words; empty where nothing suggests itself.
    """

    def __init__(self, expected: str, got: str, hint: str = "") -> None:
        self.expected, self.got, self.hint = expected, got, hint
        super().__init__(f"expected {expected}; got {got}{f'. {hint}' if hint else ''}")


class NotJudged(Exception):
    """A check has nothing to judge by; the message says why."""


def expect(holds: bool, expected: str, got: str, hint: str = "") -> None:
    """Go on where something holds.

    Raises:
        NotMet: it does not.
    """
    if not holds:
        raise NotMet(expected, got, hint)
