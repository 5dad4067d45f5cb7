"""Data class of one conformance check: the check function and its conditions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

BLIND = frozenset({"ignores_image"})
"""Capability of backends for which checks of bias are skipped."""


@dataclass(frozen=True)
class Check:
    """One conformance check: its function and its conditions.

    Attributes:
        function: raises CheckFailed if the backend violates the contract, CheckSkipped if this
            cannot be tested, and returns in words what it could not tell.
        read: module or class that documents the requirement; printed with a failure.
        after: names of checks that must not have failed, because this check would fail for the same
            reason.
        unless: capabilities of a backend for which the check is skipped.
        only_with: capabilities that a backend must have for the check to run.
    """

    function: Callable[[BackendUnderTest], None]
    read: str
    after: tuple[str, ...] = ()
    unless: frozenset[str] = frozenset()
    only_with: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """Name of the check: the function's name without "check_"."""
        return self.function.__name__.removeprefix("check_")

    @property
    def summary(self) -> str:
        """First line of the function's docstring."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]
