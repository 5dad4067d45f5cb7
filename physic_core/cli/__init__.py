"""The command ``physic``.

Everything that costs time to import is imported by the command that needs it: ``physic --help`` knows only click.
"""

from __future__ import annotations

from typing import Any

import click

from physic_core.cli.cache import cache
from physic_core.cli.config import config
from physic_core.cli.exit_codes import INTERRUPTED, MEANINGS, exit_code
from physic_core.cli.groups import ExtensibleGroup
from physic_core.cli.plugins import plugins
from physic_core.cli.run import run
from physic_core.cli.weights import weights
from physic_core.discovery.error_text import traceback_text
from physic_core.errors import PhysicError

__all__ = ["main"]


class _Group(ExtensibleGroup):
    def invoke(self, ctx: click.Context) -> Any:
        """Turn our errors into a message and the exit code of their class; PHYSIC_DEBUG=1 shows the traceback."""
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, click.Abort):
            click.echo("Aborted!", err=True)
            ctx.exit(INTERRUPTED)
        except PhysicError as error:
            click.echo(f"{traceback_text(error)}Error: {error}", err=True)
            ctx.exit(exit_code(error))


def _print_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from physic_core.discovery.plugins import core_version

        click.echo(f"physic {core_version()}")
        ctx.exit()


# The \b keeps click from wrapping the lines into one.
_EPILOG = "\b\nExit codes:\n" + "\n".join(f"  {code:<3}  {meaning}" for code, meaning in MEANINGS.items())


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]}, epilog=_EPILOG)
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_print_version, help="Print it.")
def main() -> None:
    """One photo in; people, scene and contact out, in one metric frame."""


main.add_command(run)
main.add_command(plugins)
main.add_command(config)
main.add_command(cache)
main.add_command(weights)
