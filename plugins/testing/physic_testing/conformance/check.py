"""One conformance check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

BLIND = frozenset({"ignores_image"})
"""Capability of backends for which checks of bias are skipped."""

SAME = frozenset({"stochastic"})
"""Capability of backends whose outputs differ between calls."""


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
