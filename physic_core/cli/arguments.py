"""Validation of arguments that several commands share."""

from __future__ import annotations

import click

__all__ = ["refuse_nan", "require_interface", "with_current_folder"]


def refuse_nan(ctx: click.Context, parameter: click.Parameter, value: float) -> float:
    """Return a number, as the callback of an option.

    Raises:
        BadParameter: it is NaN, which is in every range of click.
    """
    if value != value:
        raise click.BadParameter("nan is not a number", ctx, parameter)
    return value


def require_interface(name: str | None) -> None:
    """Raise UsageError if ``name`` is neither None nor the name of an interface.

    Raises:
        UsageError: the message lists the interfaces and suggests the did_you_mean one.
    """
    from physic_core.configuration.problems import did_you_mean
    from physic_core.interfaces import INTERFACES

    if name is not None and name not in INTERFACES:
        raise click.UsageError(
            f"no interface named '{name}'; there are: {', '.join(INTERFACES)}{did_you_mean(name, INTERFACES)}"
        )


def with_current_folder(name: str) -> str:
    """Add the current folder to a backend name "module:Class" if the folder contains the module."""
    from pathlib import Path

    from physic_core.discovery.local_modules import with_folder

    return with_folder(name, Path())
