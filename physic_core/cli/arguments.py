"""Checks of arguments that several commands share."""

from __future__ import annotations

import click

__all__ = ["class_here", "require_interface"]


def require_interface(name: str | None) -> None:
    """Check that ``name`` is an interface; None is allowed.

    Raises:
        UsageError: it is not; the message lists the interfaces and suggests the closest one.
    """
    from physic_core.configuration.faults import closest
    from physic_core.interfaces import INTERFACES

    if name is not None and name not in INTERFACES:
        raise click.UsageError(
            f"no interface named '{name}'; there are: {', '.join(INTERFACES)}{closest(name, INTERFACES)}"
        )


def class_here(name: str) -> str:
    """Return a backend name of the command line; a "module:Class" may be in the current folder."""
    from pathlib import Path

    from physic_core.discovery.local_modules import in_folder

    return in_folder(name, Path())
