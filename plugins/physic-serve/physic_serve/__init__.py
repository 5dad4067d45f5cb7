"""The command ``physic serve``: reconstruct photos that are uploaded in a browser or by a program."""

from __future__ import annotations

from physic_core import CommandRecord, hookimpl

__all__ = ["physic_commands"]


@hookimpl
def physic_commands() -> list[CommandRecord]:
    """Return the command "serve"."""
    return [CommandRecord("serve", "physic_serve.command:serve", "Serve a page and an HTTP interface for photos.")]
