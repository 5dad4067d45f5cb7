"""Tables and texts of ``physic plugins``."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from physic_core.discovery.catalog import how_to_install
from physic_core.discovery.error_text import describe, traceback_text
from physic_core.discovery.local_modules import split
from physic_core.discovery.readiness import Readiness, missing_requirements, readiness
from physic_core.errors import BackendError, PhysicError

if TYPE_CHECKING:
    from physic_core.discovery.registry import Claim, Registry
    from physic_core.interfaces import Backend

__all__ = ["as_dicts", "columns", "detail", "in_words", "listing"]

WIDEST = 40
"""Maximum characters of a licence or of needs in the table; ``physic plugins show`` and JSON do not shorten them."""

SLOW_SECONDS = 0.5
"""Seconds after which registration counts as slow and is reported: the module imports too much."""


def listing(registry: Registry, interface: str | None = None) -> str:
    """The table of ``physic plugins``."""
    rows = [("interface", "backend", "plugin", "version", "weights", "needs", "status")]
    for claim in registry:
        record, origin = claim.record, claim.origin
        if interface in (None, record.interface):
            # Names of the networks in brackets are for `show`.
            weights = re.sub(r"\s*\([^)]*\)", "", record.weights_license) or "-"
            who = (str(record.interface), str(record.name), origin.distribution, origin.version or "-")
            rows.append((*who, _cut(weights), _cut(_needs(claim)) or "-", _status(registry, claim)))
    for lost in registry.broken:
        origin = lost.origin
        rows.append(("-", "-", origin.distribution, origin.version or "-", "-", "-", f"BROKEN: {lost.cause}"))
    if len(rows) == 1:
        what = "no backend is installed" if interface is None else f"no backend for '{interface}' is installed"
        if registry.restriction is not None:
            return f"{what} (PHYSIC_PLUGINS='{registry.restriction}')"
        return f"{what}: {how_to_install('physic-embedded')}"
    traces = [traceback_text(lost.error).rstrip("\n") for lost in registry.broken]
    return "\n".join([columns(rows), *filter(None, traces)])


def as_dicts(registry: Registry, interface: str | None = None) -> dict[str, Any]:
    """The table of ``physic plugins`` as JSON-ready dictionaries: backends and broken plugins."""
    claims = [claim for claim in registry if interface in (None, claim.record.interface)]
    return {
        "backends": [_as_dict(registry, claim) for claim in claims],
        "broken": [{**_owner(b.origin), "cause": b.cause} for b in registry.broken],
        "restriction": registry.restriction,
    }


def detail(registry: Registry, claim: Claim) -> str:
    """Describe one backend, including its options."""
    record, status = claim.record, _status(registry, claim)
    module = claim.origin.plugin
    options: list[str] = []
    files: list[str] = []
    source = None
    if not claim.problem:
        try:
            kind = registry.load_class(claim)
            source, options = inspect.getsourcefile(kind), _options(kind.Options)
            files = _files(registry, claim, kind)
            found = readiness(registry, claim)
            if found.word in ("ready", "unsure", "not ready") and (lacking := _lacks(kind)):
                known = (found.why,) if found.word == "not ready" else ()
                status = str(Readiness("not ready", "; ".join((*known, *lacking))))
        except Exception as error:  # a plugin's door: its module, or Options of any kind
            said = str(error) if isinstance(error, BackendError) else describe(error, module)
            options = [f"  options   unknown: {said}", *filter(None, [traceback_text(error).rstrip("\n")])]
            status = "BROKEN: see options" if status == "ready" else status
    facts = [
        ("", record.summary),
        ("plugin", str(claim.origin)),
        ("class", split(str(record.target))[1]),
        ("weights", record.weights_license or "none"),
        ("needs", _needs(claim) or "nothing else"),
        ("homepage", record.homepage),
        ("status", status),
        ("source", source or ""),
        *(("files", line) for line in files),
    ]
    lines = [f"{record.interface} '{record.name}'"]
    lines += [f"  {label:<10}{text}" if label else f"  {text}" for label, text in facts if text]
    return "\n".join(lines + options)


def _lacks(kind: type[Backend]) -> tuple[str, ...]:
    """What a backend with default options reports as missing; empty if it cannot be constructed."""
    try:
        return missing_requirements(kind())
    except Exception:  # a plugin's door: its constructor
        return ()


def _files(registry: Registry, claim: Claim, kind: type[Backend]) -> list[str]:
    """Paths of the weight sets in its default options, or the folders that are searched."""
    from physic_core.weights.folders import places_in_words
    from physic_core.weights.locate import look
    from physic_core.weights.manifest import read_manifest

    lines = []
    for field in kind.Options.model_fields.values():
        name = field.get_default()
        for manifest in registry.manifests if isinstance(name, str) else ():
            try:
                weights = read_manifest(manifest.path).get(name) if manifest.origin == claim.origin else None
            except PhysicError as error:
                lines.append(" ".join(str(error).split()))
                continue
            if weights is not None:
                here = look(weights)
                whole = len(here.files) == len(weights.files)
                found = [here.folder] if here.folder is not None and len(here.files) > 1 else here.files.values()
                lines.append(", ".join(map(str, found)) if whole else f"'{name}' is sought in {places_in_words(name)}")
    return list(dict.fromkeys(lines))


def columns(rows: Sequence[tuple[str, ...]]) -> str:
    """Format rows as a table; the last column can have any length."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return "\n".join("  ".join([*(f"{t:<{w}}" for t, w in zip(row, widths, strict=False)), row[-1]]) for row in rows)


def _as_dict(registry: Registry, claim: Claim) -> dict[str, Any]:
    record, found = claim.record, _readiness(registry, claim)
    return {
        "interface": record.interface,
        "backend": record.name,
        **_owner(claim.origin),
        "api": record.api,
        "summary": record.summary,
        "weights_license": record.weights_license,
        "needs": list(record.needs),
        "packages": list(record.packages),
        "weights": list(record.weights),
        "homepage": record.homepage,
        "target": str(record.target),
        "status": found.word,
        "why": found.why,
        "seconds_to_register": round(claim.origin.seconds, 4),
    }


def _owner(origin: Any) -> dict[str, str]:
    return {"plugin": origin.plugin, "distribution": origin.distribution, "version": origin.version}


def _cut(text: str) -> str:
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1].rstrip(' ,;:')}…"


def _needs(claim: Claim) -> str:
    return ", ".join((*claim.record.needs, *claim.record.packages))


def _readiness(registry: Registry, claim: Claim) -> Readiness:
    from physic_core.weights.required import missing_sets

    return readiness(registry, claim, missing_sets=missing_sets)


def _status(registry: Registry, claim: Claim) -> str:
    found = _readiness(registry, claim)
    if claim.origin.seconds > SLOW_SECONDS and found.word in ("ready", "unsure", "not ready"):
        return f"{found}, slow: {claim.origin.seconds:.1f} s to register"
    return str(found)


def _options(model: Any) -> list[str]:
    fields, schema = model.model_fields, model.model_json_schema()
    if not fields:
        return ["  options   none"]
    properties, parts = schema.get("properties", {}), schema.get("$defs", {})
    rows = [
        (
            name,
            in_words(properties.get(name, {}), parts),
            "required" if field.is_required() else f"default {field.get_default(call_default_factory=True)!r}",
            field.description or "",
        )
        for name, field in fields.items()
    ]
    return ["  options", *("    " + line for line in columns(rows).splitlines())]


_NAMES = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "string": "text",
    "null": "unset",
    "array": "list",
    "object": "table",
}
_BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


def in_words(schema: dict[str, Any], parts: dict[str, Any]) -> str:
    """Describe the allowed values of a JSON schema, as in "number > 0, <= 50"."""
    if len(schema.get("allOf", ())) == 1:  # pydantic before 2.9
        schema = schema["allOf"][0]
    if "$ref" in schema:
        schema = parts.get(schema["$ref"].rpartition("/")[2], {})
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(in_words(part, parts) for part in schema["anyOf"]))
    if "enum" in schema:
        return " | ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    word = _NAMES.get(str(schema.get("type")), "value")
    if isinstance(schema.get("items"), dict) and schema["items"]:
        word = f"{word} of {in_words(schema['items'], parts)}"
    bounds = [f"{sign} {schema[key]:g}" for key, sign in _BOUNDS.items() if key in schema]
    return f"{word} {', '.join(bounds)}" if bounds else word
