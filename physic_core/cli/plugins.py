"""``physic plugins``: what is installed, and what each backend is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.doctor import doctor
from physic_core.cli.listing import as_dicts, detail, listing
from physic_core.cli.scaffold import new

if TYPE_CHECKING:
    from physic_core.registry import Registry

__all__ = ["plugins"]


@click.group(invoke_without_command=True)
@click.option("--interface", metavar="NAME", help="Only backends of this interface.")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON.")
@click.pass_context
def plugins(ctx: click.Context, interface: str | None, as_json: bool) -> None:
    """List installed backends; show, check, compare or begin one."""
    if ctx.invoked_subcommand is None:
        import json

        from physic_core.faults import closest
        from physic_core.interfaces import INTERFACES
        from physic_core.plugins import discover

        if interface is not None and interface not in INTERFACES:
            known = ", ".join(INTERFACES)
            raise click.UsageError(
                f"no interface named '{interface}'; there are: {known}{closest(interface, INTERFACES)}"
            )
        found = discover()
        click.echo(json.dumps(as_dicts(found, interface), indent=2) if as_json else listing(found, interface))


@plugins.command()
@click.argument("name")
def show(name: str) -> None:
    """Say what the backends called NAME are: options, licence, source."""
    from physic_core.plugins import discover

    click.echo(details(discover(), name))


@plugins.command("check")
@click.argument("name")
@click.option("--interface", metavar="NAME", help="Only the backend of this interface.")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of the backend, as in TOML.")
@click.option("--device", default="cpu", show_default=True, metavar="NAME", help="cpu, cuda or cuda:N.")
@click.option("--json", "as_json", is_flag=True, help="Print the whole report as JSON.")
@click.pass_context
def check_command(
    ctx: click.Context, name: str, interface: str | None, options: tuple[str, ...], device: str, as_json: bool
) -> None:
    """Try the backends called NAME on photos of synthetic worlds, and say what they do wrong.

    NAME is a backend, DISTRIBUTION:BACKEND, or PACKAGE.MODULE:CLASS together with --interface. Ends with code 1 if a
    check fails, or if nothing could be asked.
    """
    import json

    from physic_core.plugins import discover
    from physic_core.testing.conformance import check_backend

    registry = discover()
    given = _values(options) or None
    reports = []
    for own in [interface] if interface is not None else interfaces_of(registry, name):
        reports.append(check_backend(name, own, options=given, registry=registry, device=device))
        if not as_json:
            click.echo(reports[-1].text + "\n")
    if as_json:
        click.echo(json.dumps([report.as_dict() for report in reports], indent=2))
    ctx.exit(0 if all(report.ok for report in reports) else 1)


@plugins.command("compare")
@click.argument("interface")
@click.argument("names", nargs=-1, required=True)
@click.option(
    "--world", "worlds", multiple=True, metavar="NAME[:SEED]", help="A world to try them on; may be repeated."
)
@click.option("--device", default="cpu", show_default=True, metavar="NAME", help="cpu, cuda or cuda:N.")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
def compare_command(
    interface: str, names: tuple[str, ...], worlds: tuple[str, ...], device: str, as_json: bool
) -> None:
    """Print the errors of several backends of INTERFACE on the same synthetic worlds, side by side."""
    import json

    from physic_core.testing.conformance.compare import COMPARED, compare

    chosen = [(world.partition(":")[0], _seed(world)) for world in worlds] or COMPARED
    found = compare(interface, names, worlds=chosen, device=device)
    click.echo(json.dumps(found.as_dict(), indent=2) if as_json else found.text)


def interfaces_of(registry: Registry, name: str) -> list[str]:
    """The interfaces that have a backend of this name.

    Raises:
        BackendNotFoundError: none has.
    """
    return list(dict.fromkeys(claim.record.interface for claim in registry.called(name)))


def details(registry: Registry, name: str) -> str:
    """The text of ``physic plugins show NAME``.

    Raises:
        BackendNotFoundError: no backend is called so.
    """
    return "\n\n".join(detail(registry, claim) for claim in registry.called(name))


def _values(options: Sequence[str]) -> dict[str, Any]:
    """KEY=VALUE as TOML says it; what is no TOML value is a text."""
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


def _seed(world: str) -> int:
    _, colon, seed = world.partition(":")
    if colon and not seed.isdecimal():
        raise click.UsageError(f"--world {world}: write NAME or NAME:SEED, the seed a whole number")
    return int(seed) if colon else 0


plugins.add_command(doctor)
plugins.add_command(new)
