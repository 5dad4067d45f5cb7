"""Set up a machine: weights, the estimators of a preset, and a configuration."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the commands "setup", "weights fetch" and "config init"."""
    return [
        PluginItem(
            "config init", "physic_setup.commands:init", "Write a configuration with every setting."
        ),
        PluginItem(
            "setup",
            "physic_setup.commands:setup",
            "Print or run the steps that install a preset's estimators.",
        ),
        PluginItem(
            "weights fetch",
            "physic_setup.commands:fetch",
            "Download the missing files of weight sets.",
        ),
    ]
