"""Format the tables and descriptions that ``physic plugins`` prints."""

from __future__ import annotations

import inspect
import re
from typing import TYPE_CHECKING, Any

from physic_core.cli.output import format_table
from physic_core.discovery.error_text import describe_error, traceback_text
from physic_core.discovery.local_modules import split_folder
from physic_core.discovery.readiness import Readiness, missing_requirements, readiness
from physic_core.errors import BackendError, PhysicError

if TYPE_CHECKING:
    from physic_core.discovery.registry import BackendOffer, Registry
    from physic_core.interfaces import Backend

_MAX_CELL_WIDTH = 40
"""Maximum characters of a licence or of needs in the table; ``physic plugins show`` prints them in full."""

_SLOW_SECONDS = 0.5
"""Registration time above which the status of a backend is "slow": its module imports too much."""


def plugins_table(registry: Registry, interface: str | None = None) -> str:
    """Format the table of installed backends and broken plugins."""
    rows = [("interface", "backend", "plugin", "version", "weights", "needs", "status")]
    for offer in registry:
        record, origin = offer.record, offer.origin
        if interface in (None, record.interface):
            # The names of the networks, in parentheses, are only printed by `show`.
            weights = re.sub(r"\s*\([^)]*\)", "", _licence(registry, offer)) or "-"
            who = (str(record.interface), str(record.name), origin.distribution, origin.version or "-")
            rows.append((*who, _shorten(weights), _shorten(_needs(offer)) or "-", _status(registry, offer)))
    for broken in registry.broken:
        origin = broken.origin
        rows.append(("-", "-", origin.distribution, origin.version or "-", "-", "-", f"BROKEN: {broken.cause}"))
    if len(rows) == 1:
        what = "no backend is installed" if interface is None else f"no backend for '{interface}' is installed"
        from physic_core.discovery.catalog import how_to_install

        if registry.restriction is not None:
            return f"{what} (PHYSIC_PLUGINS='{registry.restriction}')"
        return f"{what}: {how_to_install('physic-embedded')}"
    traces = [traceback_text(broken.error).rstrip("\n") for broken in registry.broken]
    return "\n".join([format_table(rows), *filter(None, traces)])


def plugins_as_dicts(registry: Registry, interface: str | None = None) -> dict[str, Any]:
    """Return the installed backends and broken plugins as dictionaries for JSON."""
    offers = [offer for offer in registry if interface in (None, offer.record.interface)]
    return {
        "backends": [_as_dict(registry, offer) for offer in offers],
        "broken": [{**_owner(b.origin), "cause": b.cause} for b in registry.broken],
        "restriction": registry.restriction,
    }


def describe_backend(registry: Registry, offer: BackendOffer) -> str:
    """Format the record, status, files and options of one backend."""
    record, status = offer.record, _status(registry, offer)
    module = offer.origin.plugin
    options: list[str] = []
    files: list[str] = []
    source = None
    if not offer.problem:
        try:
            kind = registry.load_class(offer)
            source, options = inspect.getsourcefile(kind), _options(kind.Options)
            files = _files(registry, offer, kind)
            found = readiness(registry, offer)
            if found.word in ("ready", "unsure", "not ready") and (messages := _missing_by_default(kind)):
                known = (found.why,) if found.word == "not ready" else ()
                status = str(Readiness("not ready", "; ".join((*known, *messages))))
        except Exception as error:  # a plugin may raise anything
            text = str(error) if isinstance(error, BackendError) else describe_error(error, module)
            options = [f"  options   unknown: {text}", *filter(None, [traceback_text(error).rstrip("\n")])]
            status = "BROKEN: see options" if status == "ready" else status
    facts = [
        ("", record.summary),
        ("plugin", str(offer.origin)),
        ("class", split_folder(str(record.target))[1]),
        ("weights", _licence(registry, offer) or "none"),
        ("needs", _needs(offer) or "nothing else"),
        ("homepage", record.homepage),
        ("status", status),
        ("source", source or ""),
        *(("files", line) for line in files),
    ]
    lines = [f"{record.interface} '{record.name}'"]
    lines += [f"  {label:<10}{text}" if label else f"  {text}" for label, text in facts if text]
    return "\n".join(lines + options)


def _missing_by_default(kind: type[Backend]) -> tuple[str, ...]:
    """Return what a backend with default options reports as missing; empty if it cannot be constructed."""
    try:
        return missing_requirements(kind())
    except Exception:  # a plugin may raise anything
        return ()


def _files(registry: Registry, offer: BackendOffer, kind: type[Backend]) -> list[str]:
    """List the paths of the weight sets in a backend's default options, or the folders that are searched."""
    from physic_core.weights.find import common_folder, describe_search_folders, locate_files
    from physic_core.weights.manifest import read_manifest

    lines = []
    for field in kind.Options.model_fields.values():
        name = field.get_default()
        for manifest in registry.manifests if isinstance(name, str) else ():
            try:
                weights = read_manifest(manifest.path).get(name) if manifest.origin == offer.origin else None
            except PhysicError as error:
                lines.append(" ".join(str(error).split()))
                continue
            if weights is not None:
                here = locate_files(weights)
                complete = len(here) == len(weights.files)
                folder = common_folder(here)
                found = here.values() if folder is None else [folder]
                searched = f"'{name}' is missing; searched: {describe_search_folders(name)}"
                lines.append(", ".join(map(str, found)) if complete else searched)
    return list(dict.fromkeys(lines))


def _as_dict(registry: Registry, offer: BackendOffer) -> dict[str, Any]:
    record, found = offer.record, _readiness(registry, offer)
    return {
        "interface": record.interface,
        "backend": record.name,
        **_owner(offer.origin),
        "api": record.api,
        "summary": record.summary,
        "weights_license": _licence(registry, offer),
        "needs": list(record.needs),
        "packages": list(record.packages),
        "weights": list(record.weights),
        "homepage": record.homepage,
        "target": str(record.target),
        "status": found.word,
        "why": found.why,
        "seconds_to_register": round(offer.origin.seconds, 4),
    }


def _owner(origin: Any) -> dict[str, str]:
    return {"plugin": origin.plugin, "distribution": origin.distribution, "version": origin.version}


def _shorten(text: str) -> str:
    return text if len(text) <= _MAX_CELL_WIDTH else f"{text[: _MAX_CELL_WIDTH - 1].rstrip(' ,;:')}…"


def _needs(offer: BackendOffer) -> str:
    return ", ".join((*offer.record.needs, *offer.record.packages))


def _licence(registry: Registry, offer: BackendOffer) -> str:
    from physic_core.weights.library import weights_licence

    return weights_licence(registry, offer)


def _readiness(registry: Registry, offer: BackendOffer) -> Readiness:
    from physic_core.weights.library import missing_sets

    return readiness(registry, offer, missing_sets=missing_sets)


def _status(registry: Registry, offer: BackendOffer) -> str:
    found = _readiness(registry, offer)
    if offer.origin.seconds > _SLOW_SECONDS and found.word in ("ready", "unsure", "not ready"):
        return f"{found}, slow: {offer.origin.seconds:.1f} s to register"
    return str(found)


def _options(model: Any) -> list[str]:
    """Format name, type, default and description of each option."""
    fields, schema = model.model_fields, model.model_json_schema()
    if not fields:
        return ["  options   none"]
    properties, parts = schema.get("properties", {}), schema.get("$defs", {})
    rows = [
        (
            name,
            describe_schema(properties.get(name, {}), parts),
            "required" if field.is_required() else f"default {field.get_default(call_default_factory=True)!r}",
            field.description or "",
        )
        for name, field in fields.items()
    ]
    return ["  options", *("    " + line for line in format_table(rows).splitlines())]


_TYPE_NAMES = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "string": "text",
    "null": "unset",
    "array": "list",
    "object": "table",
}
_BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


def describe_schema(schema: dict[str, Any], parts: dict[str, Any]) -> str:
    """Describe the allowed values of a JSON Schema as text, such as "number > 0, <= 50"."""
    if "$ref" in schema:
        schema = parts.get(schema["$ref"].rpartition("/")[2], {})
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(describe_schema(part, parts) for part in schema["anyOf"]))
    if "enum" in schema:
        return " | ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    word = _TYPE_NAMES.get(str(schema.get("type")), "value")
    if isinstance(schema.get("items"), dict) and schema["items"]:
        word = f"{word} of {describe_schema(schema['items'], parts)}"
    bounds = [f"{sign} {schema[key]:g}" for key, sign in _BOUNDS.items() if key in schema]
    return f"{word} {', '.join(bounds)}" if bounds else word
