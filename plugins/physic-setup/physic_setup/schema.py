"""JSON Schema of a configuration file for editors, with the options of the installed backends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from physic_core import engine_preset_names
from physic_core.configuration.layers import preset_names
from physic_core.configuration.model import (
    OPTIONAL_INTERFACES,
    BackendChoice,
    BodyModelChoice,
    EngineChoice,
    PhotoSettings,
    RunSettings,
    stage_models,
)
from physic_core.discovery.backends import list_backends, load_class, summary_of
from physic_core.interfaces import INTERFACES

if TYPE_CHECKING:
    from physic_core.discovery.entry_points import Offer
    from physic_core.interfaces import Backend

_QUALIFIED_NAME = {
    "type": "string",
    "pattern": "^[^:]+:[^:]+$",
    "description": "'distribution:name', or 'package.module:Class' of a class that no plugin "
    "registers",
}


def config_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a configuration file. All keys are optional.

    A file lists only the differences from a preset. A backend whose options cannot be read is
    included without them.
    """
    installed = list_backends()
    classes = {
        (offer.interface, name): _class(offer)
        for offer in installed
        for name in _names(offer, installed)
    }
    kinds = {key: kind.Options if kind else None for key, kind in classes.items()}
    tables: dict[str, type[BaseModel]] = {
        "photo": PhotoSettings,
        "body_model": BodyModelChoice,
        "run": RunSettings,
        "engine": EngineChoice,
    }
    presets = engine_preset_names()
    stages = dict.fromkeys(table for preset in presets for table in stage_models(preset).values())
    models = [*tables.values(), *stages, *(kind for kind in kinds.values() if kind is not None)]
    places, top = models_json_schema([(model, "validation") for model in dict.fromkeys(models)])
    parts = top.get("$defs", {})
    for model in (*tables.values(), *stages):
        parts[places[model, "validation"]["$ref"].rpartition("/")[2]].pop("required", None)
    engine = parts[places[EngineChoice, "validation"]["$ref"].rpartition("/")[2]]
    engine["properties"]["preset"] |= {"enum": list(presets)}
    engine["allOf"] = [_preset_condition(preset, places) for preset in presets]
    interfaces = {}
    for interface in INTERFACES:
        options = {
            name: None if kind is None else places[kind, "validation"]
            for (own, name), kind in kinds.items()
            if own == interface
        }
        summaries = {
            name: summary_of(kind) if kind else ""
            for (own, name), kind in classes.items()
            if own == interface
        }
        interfaces[interface] = _interface(interface, options, summaries)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Configuration of PhySIC",
        "type": "object",
        "additionalProperties": False,
        "properties": {
            "extends": {
                "description": "a preset, or the path of another file",
                "anyOf": [
                    {"enum": list(preset_names())},
                    {"type": "string", "pattern": r"(\.toml|\.json)$|/"},
                ],
            },
            **interfaces,
            **{name: places[table, "validation"] for name, table in tables.items()},
        },
        "$defs": parts,
    }


def _preset_condition(preset: str, places: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the JSON Schema condition that gives each stage the settings of one engine preset."""
    chosen: dict[str, Any] = {"properties": {"preset": {"const": preset}}}
    if preset != EngineChoice.model_fields["preset"].default:
        chosen["required"] = ["preset"]
    tables = {stage: places[table, "validation"] for stage, table in stage_models(preset).items()}
    return {"if": chosen, "then": {"properties": tables}}


def _names(offer: Offer, installed: tuple[Offer, ...]) -> tuple[str, ...]:
    """Return the valid names of a backend; the name without distribution only if it is unique."""
    qualified = f"{offer.distribution}:{offer.name}"
    twins = [one for one in installed if (one.interface, one.name) == (offer.interface, offer.name)]
    return (offer.name, qualified) if len(twins) == 1 else (qualified,)


def _interface(
    interface: str, options: dict[str, Any], summaries: dict[str, str]
) -> dict[str, Any]:
    """Return the JSON Schema of one interface's table; the allowed options depend on the
    backend.
    """
    names = [{"const": name, "description": summaries[name]} for name in options]
    if interface in OPTIONAL_INTERFACES:
        names.append({"const": "none", "description": "leave it out"})
    descriptions = {name: field.description for name, field in BackendChoice.model_fields.items()}
    return {
        "type": "object",
        "description": (INTERFACES[interface].__doc__ or "").partition("\n")[0],
        "additionalProperties": False,
        "properties": {
            "backend": {"description": descriptions["backend"], "anyOf": [*names, _QUALIFIED_NAME]},
            "options": {"type": "object", "description": descriptions["options"]},
        },
        "allOf": [
            {
                "if": {"required": ["backend"], "properties": {"backend": {"const": name}}},
                "then": {"properties": {"options": place}},
            }
            for name, place in options.items()
            if place is not None
        ],
    }


def _class(offer: Offer) -> type[Backend] | None:
    """Return the class of a backend, or None if it cannot be imported, or its options cannot be
    described.
    """
    try:
        kind = load_class(offer)
        kind.Options.model_json_schema()
    except Exception:  # a plugin may raise anything, or have Options that pydantic cannot describe
        return None
    return kind
