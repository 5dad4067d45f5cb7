"""The command ``physic serve``: a page in the browser that reconstructs photos on this computer."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__ = ["physic_commands"]


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the command "serve"."""
    return [
        PluginItem(
            "serve", "physic_serve.command:serve", "Reconstruct photos on a page in the browser."
        )
    ]
