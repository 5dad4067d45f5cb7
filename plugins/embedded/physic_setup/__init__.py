"""Set up a machine: weights, and the estimators of a preset."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the commands "setup" and "weights"."""
    return [
        PluginItem(
            "setup",
            "physic_setup.commands:setup",
            "Print or run the steps that install a preset's estimators.",
        ),
        PluginItem(
            "weights",
            "physic_setup.weights_commands:weights",
            "List, download and verify the weights that plugins need.",
        ),
    ]
