"""The command ``physic schema``: where the JSON Schema of results is."""

from __future__ import annotations

import click

from physic_core.cli.output import echo


@click.command()
@click.option("--print", "content", is_flag=True, help="Print the schema itself.")
def schema(content: bool) -> None:
    """Print the path of the JSON Schema of reconstruction.json.

    A configuration has a schema of its own: physic config schema.
    """
    from physic_core.io.schema_file import result_schema_file

    echo(result_schema_file().read_text(encoding="utf-8") if content else str(result_schema_file()), nl=not content)
