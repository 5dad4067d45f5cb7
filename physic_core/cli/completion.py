"""The command ``physic completion``: click's completion scripts, which call ``physic``."""

from __future__ import annotations

import click

from physic_core.cli.output import echo


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print a completion script for SHELL, which calls physic whenever it completes a word."""
    from click.shell_completion import get_completion_class

    script = get_completion_class(shell)
    assert script is not None  # click has a class for each of the choices
    echo(script(ctx.find_root().command, {}, "physic", "_PHYSIC_COMPLETE").source(), nl=False)
