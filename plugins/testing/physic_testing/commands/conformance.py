"""The command ``physic plugins check``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import click

from physic_core.cli.arguments import Device, require_interface, with_current_folder
from physic_core.cli.exit_codes import BACKEND, WEIGHTS
from physic_core.cli.output import echo, echo_json, show_progress

DEVICE = click.option(
    "--device",
    type=Device(),
    default="cpu",
    show_default=True,
    metavar="NAME",
    help="cpu, cuda or cuda:N.",
)


@click.command()
@click.argument("name")
@click.option("--interface", metavar="NAME", help="Only the backend of this interface.")
@click.option(
    "--option",
    "options",
    multiple=True,
    metavar="KEY=VALUE",
    help="An option of the backend, as in TOML.",
)
@DEVICE
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@click.pass_context
def check(
    ctx: click.Context,
    name: str,
    interface: str | None,
    options: tuple[str, ...],
    device: str,
    as_json: bool,
) -> None:
    """Run the conformance tests on the backends called NAME.

    The tests use photos of synthetic worlds, and print each violation of the contract.

    NAME is a backend, DISTRIBUTION:BACKEND, or PACKAGE.MODULE:CLASS. Ends with code 5 if a check
    fails, and with 4 if the backend could not run because something is missing on this
    machine.
    """
    from physic_core.discovery.backends import find_backend, find_by_name
    from physic_testing.conformance import check_backend, checks_for

    require_interface(interface)
    name = with_current_folder(name)
    given_options = _parse_options(options) or None
    interfaces = (
        [interface]
        if interface is not None
        else list(dict.fromkeys(o.interface for o in find_by_name(name)))
    )
    for kind in interfaces:
        # raises an error before the checks of the other interfaces start, which take minutes
        find_backend(kind, name)
    if not as_json:
        count = sum(len(checks_for(kind)) for kind in interfaces)
        echo(f"{count} checks of {', '.join(interfaces)}; a network takes about a minute", err=True)
    reports = []
    for kind in interfaces:
        with show_progress(as_json or not sys.stderr.isatty()) as progress:
            reports.append(
                check_backend(name, kind, options=given_options, device=device, progress=progress)
            )
        if not as_json:
            echo(reports[-1].text + "\n")
    if as_json:
        echo_json([report.as_dict() for report in reports])
    if any(report.failures for report in reports):
        ctx.exit(BACKEND)
    ctx.exit(WEIGHTS if any(report.not_run_reason for report in reports) else 0)


def _parse_options(options: Sequence[str]) -> dict[str, Any]:
    """Parse KEY=VALUE options; a value that is not valid TOML is a string."""
    import tomllib

    values: dict[str, Any] = {}
    for text in options:
        key, equals, value = text.partition("=")
        if not equals:
            raise click.UsageError(f"--option {text}: write KEY=VALUE")
        try:
            values[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[key] = value
    return values
