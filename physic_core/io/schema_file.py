"""The JSON Schema of ``reconstruction.json``, which is shipped beside this module."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any


def result_schema_file() -> Path:
    """Return the path of the JSON Schema (draft 2020-12) of ``reconstruction.json`` for the current version."""
    return Path(__file__).with_name("reconstruction.schema.json")


def schema_fault(document: Any) -> str:
    """Return what in a document is missing, or of the wrong type by the schema; "" if nothing is."""
    from fastjsonschema import JsonSchemaValueException

    try:
        _validator()(document)
    except JsonSchemaValueException as error:
        path = ".".join(map(str, error.path[1:])) or "the document"
        if error.rule == "required":
            missing = [name for name in error.definition["required"] if name not in error.value]
            return f"{path[:200]} has no {', '.join(missing)}"
        return f"{path[:200]!r} is {reprlib.repr(error.value)}, which is not of this entry's type"
    except RecursionError:
        return "its values are nested too deeply"
    return ""


@cache
def _validator() -> Callable[[Any], Any]:
    import fastjsonschema

    schema = json.loads(result_schema_file().read_text(encoding="utf-8"))
    made: Callable[[Any], Any] = fastjsonschema.compile(schema, use_default=False)
    return made
