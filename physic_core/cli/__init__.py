"""The command ``physic``.

Everything that costs time to import is imported by the command that needs it: ``physic --help`` knows only click.
"""

from __future__ import annotations

import os
import sys
from typing import Any

import click

from physic_core.cli.bench import bench
from physic_core.cli.cache import cache
from physic_core.cli.config import config
from physic_core.cli.plugins import plugins
from physic_core.cli.run import run
from physic_core.cli.weights import weights
from physic_core.errors import PhysicError

__all__ = ["main"]


class _Group(click.Group):
    def invoke(self, ctx: click.Context) -> Any:
        """Turn our errors into one clean message and exit code 1; PHYSIC_DEBUG=1 lets the traceback through."""
        try:
            return super().invoke(ctx)
        except PhysicError as error:
            if os.environ.get("PHYSIC_DEBUG", "0") not in ("", "0"):
                raise
            raise click.ClickException(str(error)) from error


def _print_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from physic_core.plugins import core_version

        click.echo(f"physic {core_version()}")
        ctx.exit()


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_print_version, help="Print it.")
def main() -> None:
    """One photo in; people, scene and contact out, in one metric frame."""
    # A config may name a class beside it ("my_depth:MyDepth"); last, so that nothing installed is hidden.
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())


main.add_command(run)
main.add_command(plugins)
main.add_command(config)
main.add_command(bench)
main.add_command(cache)
main.add_command(weights)
