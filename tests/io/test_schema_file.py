"""The JSON Schema of ``reconstruction.json``, and its page."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from physic_core import save_reconstruction
from physic_core.io.schema_file import result_schema_file

SCHEMA = json.loads(result_schema_file().read_text(encoding="utf-8"))


def faults(document: Any) -> list[str]:
    return [f"{e.json_path}: {e.message}" for e in jsonschema.Draft202012Validator(SCHEMA).iter_errors(document)]


def saved(folder: Path) -> Any:
    return json.loads((folder / "reconstruction.json").read_bytes())


def properties(schema: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    for name, one in schema.get("properties", {}).items():
        yield prefix + name, one
        for inner in (one, *one.get("anyOf", ())):
            yield from properties(inner, f"{prefix}{name}.")


@pytest.mark.parametrize("people", [0, 2])
def test_a_saved_result_is_valid(tmp_path: Path, make: Any, people: int):
    save_reconstruction(make(40, 30, people), tmp_path, "exact")
    assert faults(saved(tmp_path)) == []


def test_a_result_of_the_pipeline_fulfils_the_schema_without_further_keys(tmp_path: Path):
    from physic_core import reconstruct
    from physic_testing import build_world

    save_reconstruction(reconstruct(build_world("walk").image, "mock"), tmp_path, "exact")
    document = saved(tmp_path)
    assert faults(document) == []
    defined = SCHEMA["$defs"]
    assert set(document) - set(SCHEMA["properties"]) == set()
    assert set(document["checks"][0]) == set(defined["check"]["properties"])
    assert set(document["people"][0]) == set(defined["person"]["properties"])
    assert set(document["contact_partners"][0]) == set(defined["partner"]["properties"])
    assert set(document["people"][0]["contacts"][0]) == set(defined["contact"]["properties"])
    assert set(document["intrinsics"]) == set(defined["intrinsics"]["properties"])
    assert set(document["stages"][0]) == set(defined["stage"]["properties"])
    assert set(document["stages"][0]["backend"]) == set(defined["backend"]["properties"])
    assert set(document["scene"]) == set(SCHEMA["properties"]["scene"]["properties"])


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"grade": "fine"}, "$.grade: 'fine' is not one of ['good', 'doubtful', 'bad', None]"),
        ({"schema_version": 1}, "$.schema_version: 5 was expected"),
        ({"people": None}, "$.people: None is not of type 'array'"),
    ],
    ids=["grade", "version", "people"],
)
def test_the_json_schema_finds_a_fault(tmp_path: Path, make: Any, change: dict[str, Any], fault: str):
    save_reconstruction(make(40, 30, 0), tmp_path, "exact")
    assert faults(saved(tmp_path) | change) == [fault]


def test_every_key_is_described_in_the_schema():
    nested = dict(properties(SCHEMA))
    assert [name for name, one in SCHEMA["properties"].items() if "description" not in one] == []
    for name in SCHEMA["$defs"].keys() - {"number", "array"}:
        nested |= dict(properties(SCHEMA["$defs"][name], f"{name}."))
    assert [name for name, one in nested.items() if not {"description", "$ref"} & set(one)] == []
