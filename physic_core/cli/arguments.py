"""What several commands ask of their arguments."""

from __future__ import annotations

import click

__all__ = ["class_here", "require_interface"]


def require_interface(name: str | None) -> None:
    """Refuse what is no interface's name; None is allowed.

    Raises:
        UsageError: with the names that there are, and the nearest one.
    """
    from physic_core.configuration.faults import closest
    from physic_core.interfaces import INTERFACES

    if name is not None and name not in INTERFACES:
        raise click.UsageError(
            f"no interface named '{name}'; there are: {', '.join(INTERFACES)}{closest(name, INTERFACES)}"
        )


def class_here(name: str) -> str:
    """A backend's name as given on the command line; a "module:Class" may lie in the current folder."""
    from pathlib import Path

    from physic_core.discovery.local_modules import in_folder

    return in_folder(name, Path())
