"""What several commands ask of their arguments."""

from __future__ import annotations

import click

__all__ = ["require_interface"]


def require_interface(name: str | None) -> None:
    """Refuse what is no interface's name; None is allowed.

    Raises:
        UsageError: with the names that there are, and the nearest one.
    """
    from physic_core.faults import closest
    from physic_core.interfaces import INTERFACES

    if name is not None and name not in INTERFACES:
        raise click.UsageError(
            f"no interface named '{name}'; there are: {', '.join(INTERFACES)}{closest(name, INTERFACES)}"
        )
