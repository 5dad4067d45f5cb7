"""Set up a machine: weights, the estimators of a preset, and a configuration."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the commands "setup" and "weights fetch", and those that help to write a
    configuration.
    """
    return [
        PluginItem(
            "config init", "physic_setup.commands:init", "Write a configuration with every setting."
        ),
        PluginItem(
            "config schema",
            "physic_setup.commands:schema",
            "Print the JSON Schema of a configuration.",
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
