"""For tests, of the core and of plugins: synthetic worlds with ground truth, and the conformance kit of backends."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from physic_core.testing.conformance import Report, check_backend, parametrize_with_checks
    from physic_core.testing.worlds import WORLDS, World, build_world

__all__ = ["WORLDS", "Report", "World", "build_world", "check_backend", "parametrize_with_checks"]

_ON_FIRST_USE = {
    "Report": "physic_core.testing.conformance",
    "check_backend": "physic_core.testing.conformance",
    "parametrize_with_checks": "physic_core.testing.conformance",
    "WORLDS": "physic_core.testing.worlds",
    "World": "physic_core.testing.worlds",
    "build_world": "physic_core.testing.worlds",
}


def __getattr__(name: str) -> Any:
    if name not in _ON_FIRST_USE:
        raise AttributeError(f"module 'physic_core.testing' has no attribute '{name}'")
    return getattr(import_module(_ON_FIRST_USE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
