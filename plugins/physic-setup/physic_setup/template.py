"""Write a configuration file with every key, its value, meaning and allowed values, commented
out.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import re
import textwrap
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

from physic_core.cli.listing import describe_schema
from physic_core.cli.output import toml_value
from physic_core.configuration.model import load_config, settings_model, stage_models
from physic_core.discovery.backends import find_backend, load_class
from physic_core.errors import BackendError
from physic_core.interfaces import INTERFACES

if TYPE_CHECKING:
    from pydantic import BaseModel

    from physic_core.configuration.model import Config

_WIDTH = 118
_HEAD = """\
## Every setting, with the value that it has in this preset. To change one, remove the single # of
## its line and of the [table] that it is in. Lines with ## are explanations. They also name the
## settings without a value.
"""


def config_template(preset: str) -> str:
    """Return the text of a configuration that extends a preset, with all settings commented out.

    The values are those of the preset.

    Args:
        preset: name of the preset.
    """
    found = load_config(preset=preset)
    lines = [f'extends = "{preset}"', "", _HEAD.rstrip()]
    for interface in INTERFACES:
        lines += _interface(found, interface)
    for name in ("photo", "body_model", "run", "engine"):
        model = getattr(found, name)
        values = {
            key: getattr(model, key)
            for key in type(model).model_fields
            if key not in stage_models()
        }
        lines += _table(name, values, _meanings(type(model)))
    settings = found.engine.settings()
    for stage in fields(settings):
        own = getattr(settings, stage.name)
        title = _plain((type(own).__doc__ or "").partition("\n")[0])
        lines += _settings(f"engine.{stage.name}", own, title)
    return "\n".join(lines) + "\n"


def _interface(found: Config, interface: str) -> list[str]:
    chosen = found.choice(interface)
    lines = _table(
        interface,
        {"backend": chosen.backend},
        {"backend": "the backend; `physic plugins` lists all"},
    )
    if chosen.backend == "none":
        return lines
    options: Mapping[str, Any] = chosen.options
    meanings: Mapping[str, str] = {}
    try:
        kind = load_class(find_backend(interface, chosen.backend)).Options
        options = kind.model_validate(dict(options)).model_dump(mode="json")
        meanings = _meanings(kind)
    except BackendError as error:
        lines += _prose(
            f"The options of '{chosen.backend}' are not listed: {str(error).partition(chr(10))[0]}"
        )
    return lines + (_table(f"{interface}.options", options, meanings) if options else [])


def _table(
    name: str, values: Mapping[str, Any], meanings: Mapping[str, str], title: str = ""
) -> list[str]:
    lines = ["", f"# [{name}]", *_prose(title)]
    for key, value in values.items():
        if value is None:
            lines += _prose(f"{key}, not set: {meanings.get(key, '')}")
        else:
            lines += [*_prose(meanings.get(key, "")), f"# {key} = {toml_value(value)}"]
    return lines


def _prose(text: str) -> list[str]:
    return [f"## {line}" for line in textwrap.wrap(text, _WIDTH, break_on_hyphens=False)]


def _meanings(model: type[BaseModel]) -> dict[str, str]:
    """Return the meaning and allowed values of each field of a pydantic model."""
    schema = model.model_json_schema()
    properties = schema.get("properties", {})
    parts = schema.get("$defs", {})
    return {
        name: _with_kind(field.description or "", describe_schema(properties.get(name, {}), parts))
        for name, field in model.model_fields.items()
    }


def _settings(name: str, settings: Any, title: str) -> list[str]:
    """Format engine settings as a TOML table, followed by the tables of nested settings."""
    values = {field.name: getattr(settings, field.name) for field in fields(settings)}
    own = {key: value for key, value in values.items() if not is_dataclass(value)}
    lines = _table(name, own, _engine_meanings(type(settings)), title)
    titles = texts_of_fields(type(settings))
    for key, value in values.items():
        if is_dataclass(value):
            lines += _settings(f"{name}.{key}", value, titles[key])
    return lines


def _engine_meanings(kind: type) -> dict[str, str]:
    """Return the meaning of each setting from its docstring, and the type from its annotation."""
    schema = settings_model(kind).model_json_schema()
    parts = schema.get("$defs", {})
    meanings = texts_of_fields(kind)
    return {
        # All keys are optional in the model, but "unset" is not an allowed value.
        name: _with_kind(
            meanings.get(name, ""), describe_schema(one, parts).removesuffix(" or unset")
        )
        for name, one in schema["properties"].items()
    }


def _with_kind(meaning: str, kind: str) -> str:
    return f"{meaning.removesuffix('.')} ({kind})" if meaning else kind


def texts_of_fields(kind: type) -> dict[str, str]:
    """Return the text under each field by the name of the field."""
    found = {}
    for base in filter(is_dataclass, reversed(kind.__mro__)):
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0].body  # type: ignore[attr-defined]
        for field, text in itertools.pairwise(body):
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
            ):
                found[ast.unparse(field.target)] = str(text.value.value)
    texts = {field.name: found[field.name] for field in fields(kind) if field.name in found}
    return {name: _plain(" ".join(text.split())) for name, text in texts.items()}


def _plain(text: str) -> str:
    """Remove reStructuredText markup."""
    return re.sub(r":\w+:`([^`]+)`", r"\1", text).replace("``", "")
