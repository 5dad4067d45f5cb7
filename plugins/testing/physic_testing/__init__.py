"""Synthetic worlds with ground truth, and tools for authors of plugins."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from physic_core import PluginItem, hookimpl

if TYPE_CHECKING:
    from physic_testing.conformance import (
        Report,
        check_backend,
        parametrize_with_checks,
        violations,
    )
    from physic_testing.worlds import WORLDS, World, load_world, world_of

__all__ = [
    "WORLDS",
    "Report",
    "World",
    "check_backend",
    "load_world",
    "parametrize_with_checks",
    "violations",
    "world_of",
]

_ON_FIRST_USE = {
    "Report": "physic_testing.conformance",
    "check_backend": "physic_testing.conformance",
    "parametrize_with_checks": "physic_testing.conformance",
    "violations": "physic_testing.conformance",
    "WORLDS": "physic_testing.worlds",
    "World": "physic_testing.worlds",
    "load_world": "physic_testing.worlds",
    "world_of": "physic_testing.worlds",
}


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the commands below "plugins" for authors of plugins."""
    return [
        PluginItem(
            "plugins check",
            "physic_testing.commands.conformance:check",
            "Run the conformance tests on a backend.",
        ),
        PluginItem(
            "plugins doctor",
            "physic_testing.commands.doctor:doctor",
            "Load each installed backend and report what is missing or broken.",
        ),
        PluginItem(
            "plugins new",
            "physic_testing.commands.scaffold:new",
            "Create a plugin with one backend that passes the conformance tests.",
        ),
    ]


def __getattr__(name: str) -> Any:
    if name not in _ON_FIRST_USE:
        raise AttributeError(f"module 'physic_testing' has no attribute '{name}'")
    return getattr(import_module(_ON_FIRST_USE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
