"""Validation of arguments that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click


class AnyPath(click.ParamType[Path]):
    """Any path; the code that opens it reports errors."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        if not str(value):
            self.fail("it is empty: name a file or a folder", param, ctx)
        return Path(value)


def configuration_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --config, --preset and --set to a command, which gets them as ``file``, ``preset`` and ``overrides``."""
    help_text = "A TOML file, or the reconstruction.json of a run."
    file = click.option("--config", "file", metavar="FILE", type=AnyPath(), is_eager=True, help=help_text)
    default = "Preset to build on.  [default: embedded]"
    preset = click.option("--preset", metavar="NAME", callback=_refuse_file, help=default)
    several = "Change one value; may be repeated."
    return file(preset(click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help=several)(command)))


def _refuse_file(ctx: click.Context, parameter: click.Parameter, preset: str | None) -> str | None:
    if preset is not None and ctx.params["file"] is not None:
        raise click.UsageError('--preset cannot be combined with --config: write extends = "NAME" into the file')
    return preset


def require_interface(name: str | None) -> None:
    """Raise UsageError if ``name`` is neither None nor the name of an interface.

    Raises:
        UsageError: the message lists the interfaces and suggests a similar one.
    """
    from physic_core.discovery.error_text import did_you_mean
    from physic_core.interfaces import INTERFACES

    if name is not None and name not in INTERFACES:
        raise click.UsageError(
            f"no interface named '{name}'; there are: {', '.join(INTERFACES)}{did_you_mean(name, INTERFACES)}"
        )


def with_current_folder(name: str) -> str:
    """Add the current folder to a backend name "module:Class" if the folder contains the module."""
    from physic_core.discovery.local_modules import with_folder

    return with_folder(name, Path())
