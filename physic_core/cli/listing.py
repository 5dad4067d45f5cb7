"""Format the tables and descriptions that ``physic plugins`` prints."""

from __future__ import annotations

import inspect
import os
from typing import TYPE_CHECKING, Any

from physic_core.cache.kit_stamps import has_passed_kit
from physic_core.cli.output import format_table
from physic_core.discovery.backends import (
    list_backends,
    load_class,
    missing_requirements,
    summary_of,
)
from physic_core.discovery.catalog import how_to_install
from physic_core.discovery.entry_points import PLUGINS_VARIABLE, restricted_to
from physic_core.discovery.error_text import describe_error, traceback_text
from physic_core.discovery.local_modules import split_folder
from physic_core.discovery.plugin_code import named_plugin_code
from physic_core.discovery.plugins import broken_plugins
from physic_core.errors import BackendError, PhysicError

if TYPE_CHECKING:
    from physic_core.discovery.entry_points import Offer
    from physic_core.interfaces import Backend


def plugins_table(interface: str | None = None) -> str:
    """Format the table of installed backends and broken plugins; no backend is imported.

    The state is that of the weights that a backend uses by default, by the manifests of its
    distribution, and what they say that it needs besides.
    """
    rows = [("interface", "backend", "plugin", "version", "state")]
    for one in list_backends(interface):
        rows.append(
            (one.interface, one.name, one.distribution, one.version or "-", _offer_state(one))
        )
    broken = broken_plugins()
    lines = [format_table(rows)]
    if len(rows) == 1:
        what = (
            "no backend is installed"
            if interface is None
            else f"no backend for '{interface}' is installed"
        )
        why = (
            f" ({PLUGINS_VARIABLE}={os.environ[PLUGINS_VARIABLE]!r})"
            if restricted_to() is not None
            else ""
        )
        lines = [f"{what}{why}: {how_to_install('metricbody-embedded')}"]
    lines += [f"BROKEN: {plugin}" for plugin in broken]
    lines += [traceback_text(plugin.error).rstrip("\n") for plugin in broken]
    return "\n".join(filter(None, lines))


def _offer_state(offer: Offer) -> str:
    """Return "ready", or what a backend with default options needs as far as manifests of weights
    tell.
    """
    from physic_core.weights.find import presence
    from physic_core.weights.library import default_sets

    try:
        sets = default_sets(offer)
    except PhysicError:
        return "its list of weights is invalid"
    lacking = [one.name for one in sets if presence(one) in ("missing", "in part")]
    needs = ["weights"] if lacking else []
    needs += dict.fromkeys(text for one in sets for text in one.needs.split(", ") if text)
    if needs:
        return f"needs {', '.join(needs)}"
    passed = has_passed_kit(offer.interface, offer.target)
    return "ready" if passed else f"ready; never passed `physic plugins check {offer.name}` here"


def describe_backend(offer: Offer) -> str:
    """Format the summary, weights, status and options of one backend, whose class is imported."""
    lines = [f"{offer.interface} '{offer.name}'"]
    facts = [("plugin", offer.owner), ("class", split_folder(offer.target)[1])]
    options: list[str] = []
    try:
        kind = load_class(offer)
        lines.append(f"  {summary_of(kind)}")
        facts += [
            *_weights(offer, kind),
            ("status", _availability(kind)),
            ("source", inspect.getsourcefile(kind) or ""),
        ]
        options = _options(kind.Options)
    except Exception as error:  # a plugin may raise anything
        text = (
            str(error)
            if isinstance(error, BackendError)
            else describe_error(error, offer.target.partition(":")[0])
        )
        facts += [("status", f"BROKEN: {text}"), ("", traceback_text(error).rstrip("\n"))]
    return "\n".join([*lines, *(f"  {label:<10}{text}" for label, text in facts if text), *options])


def _availability(kind: type[Backend]) -> str:
    """Return what a backend with default options says is missing."""
    with named_plugin_code("it cannot be constructed", kind):
        backend = kind()
    missing = missing_requirements(backend)
    return "; ".join(("not ready", *missing)) if missing else "ready"


def _weights(offer: Offer, kind: type[Backend]) -> list[tuple[str, str]]:
    """Return the licences and homepages of the weights in a backend's default options."""
    from physic_core.weights.library import licence_text, named_sets

    defaults = {name: field.get_default() for name, field in kind.Options.model_fields.items()}
    sets = named_sets(offer.distribution, defaults)
    rows = [("weights", licence_text(sets) or kind.weights_license or "none")]
    for one in sets:
        rows.append(("homepage", one.homepage))
    return list(dict.fromkeys(rows))


def _options(model: Any) -> list[str]:
    """Format name, type, default and description of each option."""
    fields = model.model_fields
    schema = model.model_json_schema()
    if not fields:
        return ["  options   none"]
    properties = schema.get("properties", {})
    parts = schema.get("$defs", {})
    rows = [
        (
            name,
            describe_schema(properties.get(name, {}), parts),
            "required"
            if field.is_required()
            else f"default {field.get_default(call_default_factory=True)!r}",
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
