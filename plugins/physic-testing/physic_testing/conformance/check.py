"""One check of the conformance kit: a function, and when it applies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["Check"]


@dataclass(frozen=True)
class Check:
    """One property that every backend of an interface has.

    Attributes:
        function: raises CheckFailed where the backend lacks the property, CheckSkipped where it cannot be tested.
        read: the module or class that documents the property, printed with a failure.
        after: names of checks that must not have failed, because this check would only repeat their failure.
        unless: capabilities of a backend with which the check is skipped.
        only_with: capabilities of a backend without which the check is skipped.
    """

    function: Callable[[Subject], None]
    read: str
    after: tuple[str, ...] = ()
    unless: frozenset[str] = frozenset()
    only_with: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """The function's, without "check_"."""
        return self.function.__name__.removeprefix("check_")

    @property
    def summary(self) -> str:
        """First line of its docstring."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]
