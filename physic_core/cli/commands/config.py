"""The command ``physic config``: check and show a configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.arguments import configuration_options
from physic_core.cli.exit_codes import USAGE, WEIGHTS
from physic_core.cli.groups import ExtensibleGroup
from physic_core.cli.output import echo, toml_value

if TYPE_CHECKING:
    from physic_core.configuration.model import Config


@click.group(cls=ExtensibleGroup, path="config")
def config() -> None:
    """Check, show or create a configuration."""


@config.command()
@configuration_options
@click.pass_context
def check(
    ctx: click.Context, file: Path | None, preset: str | None, overrides: tuple[str, ...]
) -> None:
    """Check a configuration, and list what this machine lacks.

    It checks the options of all backends, and opens a body model file. It loads no backend:
    only a run shows whether backends fit one another. Exits with code 2 if the configuration
    has errors or the device is missing, with 3 if a file that it names cannot be used, with 4
    if weights or the body model are missing, and with 5 if a backend is broken.
    """
    from physic_core.configuration.model import load_config
    from physic_core.configuration.resolve import (
        check_input_files,
        format_missing,
        missing_file_messages,
        missing_gpu,
        resolve,
    )

    settings = load_config(file, preset=preset, overrides=overrides)
    plan = resolve(settings)
    check_input_files(settings)
    files = missing_file_messages(plan)
    device = missing_gpu(plan)
    path = settings.body_model.path
    if path is not None and Path(path).exists():
        from physic_core.body import load_body

        load_body(path)
    echo(f"{file or f'preset {preset}' if file or preset else 'preset embedded'}: no errors")
    if files or device:
        echo(format_missing((*files, *device), "; a run would stop"))
    if files and preset:
        echo(f"`physic setup {preset}` prints the steps to get them")
    if files:
        ctx.exit(WEIGHTS)
    if device:
        ctx.exit(USAGE)


@config.command("show")
@configuration_options
def show_config(file: Path | None, preset: str | None, overrides: tuple[str, ...]) -> None:
    """Print a resolved configuration and the source of each value."""
    from physic_core.configuration.model import load_config

    echo(config_toml(load_config(file, preset=preset, overrides=overrides)), nl=False)


def config_toml(found: Config) -> str:
    """Format a configuration as TOML, with the source of each value as a comment."""
    lines = [
        line
        for name, table in found.as_dict().items()
        for line in _toml_table(name, table, found.source)
    ]
    return "\n".join(lines).lstrip("\n") + "\n"


def _toml_table(path: str, table: Mapping[str, Any], source: Callable[[str], str]) -> list[str]:
    inner = {key: value for key, value in table.items() if isinstance(value, dict) and value}
    lines = [
        f"{key} = {toml_value(value)}  # {source(f'{path}.{key}')}"
        for key, value in table.items()
        if value is not None and not isinstance(value, dict)  # TOML cannot express None
    ]
    below = [
        line for key, value in inner.items() for line in _toml_table(f"{path}.{key}", value, source)
    ]
    return [*(["", f"[{path}]", *lines] if lines else []), *below]
