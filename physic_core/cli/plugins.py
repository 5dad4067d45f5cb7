"""``physic plugins``: what is installed, and what each backend is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import click

from physic_core.errors import BackendError, BackendNotFoundError

if TYPE_CHECKING:
    from physic_core.registry import Claim, Registry

__all__ = ["plugins"]

SLOW_SECONDS = 0.5
"""A plugin that takes longer to say what it offers is named: its registration module imports too much."""


@click.group(invoke_without_command=True)
@click.option("--interface", metavar="NAME", help="Only backends of this interface.")
@click.pass_context
def plugins(ctx: click.Context, interface: str | None) -> None:
    """List installed backends, or show one."""
    if ctx.invoked_subcommand is None:
        from physic_core.faults import closest
        from physic_core.interfaces import INTERFACES
        from physic_core.plugins import discover

        if interface is not None and interface not in INTERFACES:
            known = ", ".join(INTERFACES)
            raise click.UsageError(
                f"no interface named '{interface}'; there are: {known}{closest(interface, INTERFACES)}"
            )
        click.echo(listing(discover(), interface))


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
    return list(dict.fromkeys(claim.record.interface for claim in _called(registry, name)))


def listing(registry: Registry, interface: str | None = None) -> str:
    """The table of ``physic plugins``."""
    rows = [("interface", "backend", "plugin", "version", "weights", "status")]
    for claim in registry:
        record, origin = claim.record, claim.origin
        if interface in (None, record.interface):
            # Names of the networks in brackets are for `show`.
            weights = re.sub(r"\s*\([^)]*\)", "", record.weights_license) or "-"
            status = _status(registry, claim)
            rows.append((record.interface, record.name, origin.distribution, origin.version, weights, status))
    for lost in registry.broken:
        origin = lost.origin
        rows.append(("-", "-", origin.distribution, origin.version or "-", "-", f"BROKEN: {lost.cause}"))
    if len(rows) == 1:
        what = "no backend is installed" if interface is None else f"no backend for '{interface}' is installed"
        hidden = "" if registry.restriction is None else f" (PHYSIC_PLUGINS='{registry.restriction}')"
        return f"{what}{hidden}"
    return _columns(rows)


def details(registry: Registry, name: str) -> str:
    """The text of ``physic plugins show NAME``.

    Raises:
        BackendNotFoundError: no backend is called so.
    """
    return "\n\n".join(_detail(registry, claim) for claim in _called(registry, name))


def _called(registry: Registry, name: str) -> list[Claim]:
    """The claims to a name, or to "distribution:name"; at least one."""
    distribution, _, bare = name.rpartition(":")
    claims = [c for c in registry if c.record.name == bare and distribution in ("", c.origin.distribution)]
    if not claims:
        names = sorted({c.record.name for c in registry})
        close = get_close_matches(bare, names, n=1)
        hint = f". Did you mean '{close[0]}'?" if close else ""
        raise BackendNotFoundError(f"no backend named '{name}'; installed: {', '.join(names) or 'none'}{hint}")
    return claims


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


def _detail(registry: Registry, claim: Claim) -> str:
    record = claim.record
    facts = [
        ("", record.summary),
        ("plugin", str(claim.origin)),
        ("class", str(record.target)),
        ("weights", record.weights_license or "none"),
        ("needs", ", ".join(record.needs) or "nothing else"),
        ("homepage", record.homepage),
        ("status", _status(registry, claim)),
    ]
    lines = [f"{record.interface} '{record.name}'"]
    lines += [f"  {label:<10}{text}" if label else f"  {text}" for label, text in facts if text]
    return "\n".join(lines + ([] if claim.problem else _options(registry, claim)))


def _options(registry: Registry, claim: Claim) -> list[str]:
    try:
        schema = registry.load_class(claim).Options.model_json_schema()
    except BackendError as error:
        return [f"  options   unknown: {error}"]
    properties = schema.get("properties", {})
    if not properties:
        return ["  options   none"]
    rows = [
        (k, _kind(p), f"default {p['default']!r}" if "default" in p else "required", p.get("description", ""))
        for k, p in properties.items()
    ]
    return ["  options", *("    " + line for line in _columns(rows).splitlines())]


def _kind(schema: dict[str, object]) -> str:
    if "enum" in schema and isinstance(schema["enum"], list):
        return " | ".join(map(str, schema["enum"]))
    names = {"integer": "whole number", "number": "number", "boolean": "true or false", "string": "text"}
    return names.get(str(schema.get("type")), str(schema.get("type", "value")))


def _status(registry: Registry, claim: Claim) -> str:
    if claim.problem:
        return f"REFUSED: {claim.problem}"
    if rivals := registry.rivals(claim):
        return f"AMBIGUOUS: {registry.explain_rivals((claim, *rivals))}"
    notes = [*(f"needs {need}" for need in claim.record.needs)]
    if claim.origin.seconds > SLOW_SECONDS:
        notes.append(f"slow: {claim.origin.seconds:.1f} s to register")
    return ", ".join(["ready", *notes])


def _columns(rows: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return "\n".join("  ".join([*(f"{t:<{w}}" for t, w in zip(row, widths, strict=False)), row[-1]]) for row in rows)
