"""Types of arguments that several commands share: each kind of mistake is refused in one place,
with exit code 2.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from physic_core.files.text import path_problem


class AnyPath(click.ParamType[Path]):
    """The path of a file or folder; the code that opens it reports errors."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        if problem := path_problem(str(value)):
            self.fail(problem, param, ctx)
        return Path(value)


class ResultPath(AnyPath):
    """The folder of a result, also by the path of its document."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        path = super().convert(value, param, ctx)
        return path.parent if path.name == "reconstruction.json" else path


class FolderPath(AnyPath):
    """The path of a folder, which need not be there."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        path = super().convert(value, param, ctx)
        if os.path.lexists(path) and not os.path.isdir(path):
            self.fail(f"{path} is not a folder: name one, or move that file away", param, ctx)
        return path


class Number(click.FloatRange):
    """A finite number within bounds; click lets NaN pass."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            number = float(value)
        except ValueError:
            self.fail(f"'{value}' is not a number, such as 1200 or 1.5, without a unit", param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return super().convert(number, param, ctx)

    def _describe_range(self) -> str:
        return "" if self.min is self.max is None else super()._describe_range()


class WholeNumber(click.IntRange):
    """A whole number within bounds."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            int(value)
        except ValueError:
            self.fail(f"'{value}' is not a whole number, such as 2", param, ctx)
        return super().convert(value, param, ctx)


class Numbers(click.ParamType[Any]):
    """Comma-separated numbers, such as fx,fy,cx,cy; any number of them if the name ends in dots."""

    def __init__(self, names: str) -> None:
        self.name = names

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = ()
        count = 0 if self.name.endswith("...") else self.name.count(",") + 1
        if not numbers or len(numbers) != (count or len(numbers)):
            several = count and len(numbers) > count and len(numbers) % count == 0
            cure = "repeat the option for each" if several else "without a unit"
            self.fail(f"'{value}' is not comma-separated numbers: {self.name}; {cure}", param, ctx)
        return numbers


class Device(click.ParamType[str]):
    """The name of a compute device; whether it is there is checked when it is used."""

    name = "device"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        from physic_core.backends.devices import DEVICE_PATTERN

        if not DEVICE_PATTERN.fullmatch(value):
            self.fail(f"'{value}' is not a device: name cpu, cuda or cuda:N", param, ctx)
        return str(value)


def configuration_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --config, --preset and --set to a command, which gets them as ``file``, ``preset`` and
    ``overrides``.
    """
    help_text = "A TOML file, or the reconstruction.json of a run."
    file = click.option(
        "--config", "file", metavar="FILE", type=AnyPath(), is_eager=True, help=help_text
    )
    default = "Preset to build on.  [default: embedded]"
    preset = click.option("--preset", metavar="NAME", callback=_refuse_file, help=default)
    several = "Change one value; may be repeated."
    return file(
        preset(
            click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help=several)(
                command
            )
        )
    )


def _refuse_file(ctx: click.Context, parameter: click.Parameter, preset: str | None) -> str | None:
    if preset is not None and ctx.params["file"] is not None:
        raise click.UsageError(
            '--preset cannot be combined with --config: write extends = "NAME" into the file'
        )
    return preset


def require_interface(name: str | None) -> None:
    """Raise UsageError if ``name`` is neither None nor the name of an interface."""
    from physic_core.discovery import backends
    from physic_core.errors import ConfigError

    try:
        if name is not None:
            backends.require_interface(name)
    except ConfigError as error:
        raise click.UsageError(str(error)) from error


def with_current_folder(name: str) -> str:
    """Add the current folder to a backend name "module:Class" if the folder contains the module."""
    from physic_core.discovery.local_modules import with_folder

    return with_folder(name, Path())
