"""The commands ``physic config init`` and ``physic config schema``: what helps to write a configuration."""

from __future__ import annotations

from pathlib import Path

import click

from physic_core.cli.output import echo, echo_json
from physic_core.errors import OutputError


@click.command()
@click.argument("file", type=click.Path(path_type=Path), default=Path("physic.toml"))
@click.option("--preset", metavar="NAME", default="embedded", show_default=True, help="Preset to build on.")
def init(file: Path, preset: str) -> None:
    """Write a configuration to FILE that lists every setting with its meaning, commented out.

    It lists the options of the backends that the preset uses, if they are installed.
    """
    from physic_setup.template import config_template

    text = config_template(preset)
    try:
        with file.open("x", encoding="utf-8") as out:
            out.write(text)
    except FileExistsError:
        raise OutputError(f"{file} exists already: choose another name") from None
    except OSError as error:
        raise OutputError(f"{file} cannot be written: {error.strerror}") from error
    echo(f"wrote {file}; try: physic run PHOTO --config {file}")


@click.command()
def schema() -> None:
    """Print the JSON Schema of a configuration for your editor, with the options of installed backends.

    With `physic config schema > physic.schema.json`, the first line `#:schema physic.schema.json` of a TOML file lets
    editors complete and check it (Even Better TOML, Taplo and others).
    """
    from physic_setup.schema import config_schema

    echo_json(config_schema())
