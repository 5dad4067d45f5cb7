"""The command ``physic``.

A command is imported when it runs. ``physic --help`` imports only click and the entry points of
plugins.
"""

from __future__ import annotations

import shlex
import sys
from io import StringIO
from typing import Any

import click

from physic_core.cli.exit_codes import INTERRUPTED, MEANINGS, OTHER, exit_code
from physic_core.cli.groups import ExtensibleGroup, with_suggestion
from physic_core.cli.output import echo, printed_logs
from physic_core.errors import PhysicError
from physic_core.files.text import shorten

__all__ = ["main"]

_MAX_LINE = 4096
"""Maximum characters of a message line; file and plugin names can have any length."""


_OUT_OF_MEMORY = (
    "Error: out of memory. Close other programs, allow this one more memory, use a smaller photo, "
    "or close backends early with --low-memory (physic run)"
)


class _Main(ExtensibleGroup):
    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse what stands before the command."""
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            raise with_suggestion(error) from error

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; print a PhysicError, and exit with the code of its class.

        The message of a KeyboardInterrupt says what the command has kept.
        """
        from physic_core.discovery.plugin_code import protected_stdout

        try:
            with protected_stdout(), printed_logs():
                return super().invoke(ctx)
        except (KeyboardInterrupt, click.Abort) as error:
            kept = f": {error}" if str(error) else ""
            again = shlex.join(["physic", *sys.argv[1:]])
            echo(f"stopped{kept}; to continue: {again}", err=True)
            ctx.exit(INTERRUPTED)
        except click.ClickException as error:
            shown = StringIO()
            (with_suggestion(error) if isinstance(error, click.UsageError) else error).show(shown)
            echo(shown.getvalue(), nl=False, err=True)
            ctx.exit(error.exit_code)
        except PhysicError as error:
            from physic_core.discovery.error_text import traceback_text

            message = "\n".join(shorten(line, _MAX_LINE) for line in str(error).split("\n"))
            echo(f"{traceback_text(error)}Error: {message}", err=True)
            ctx.exit(exit_code(error))
        except MemoryError:
            echo(_OUT_OF_MEMORY, err=True)
            ctx.exit(OTHER)


def _print_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from physic_core.discovery.entry_points import core_version

        echo(f"physic {core_version()}")
        ctx.exit()


_COMMANDS = {
    "cache": ("physic_core.cli.commands.cache:cache", "Show or clear the cache."),
    "config": ("physic_core.cli.commands.config:config", "Check, show or create a configuration."),
    "export": (
        "physic_core.cli.commands.results:export",
        "Export a result to Blender, Unity, MuJoCo, USD, MeshLab, ...",
    ),
    "plugins": (
        "physic_core.cli.commands.plugins:plugins",
        "List installed backends; show or test them; create a plugin.",
    ),
    "run": (
        "physic_core.cli.commands.run:run",
        "Reconstruct people, scene and contact from PHOTO.",
    ),
    "show": (
        "physic_core.cli.commands.results:show",
        "Print the people, usable marks and warnings of a saved result.",
    ),
}

# \b stops click from joining the lines.
_EPILOG = "\b\nExit codes:\n" + "\n".join(
    f"  {code:<3}  {meaning}" for code, meaning in MEANINGS.items()
)


@click.group(
    cls=_Main,
    own=_COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=_EPILOG,
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Print the version.",
)
def main() -> None:
    """Reconstruct people, scene and contact from one photo, in one metric camera frame."""
