"""Every numeric setting has a least and a greatest value."""

from __future__ import annotations

import json
import math

import pytest

from physic_core import engine_preset_names
from physic_core.configuration.model import PhotoSettings, RunSettings, stage_models
from physic_core.discovery.backends import list_backends, load_class

INFINITE = {"far_m", "robust_px_share", "robust_m"}
"""Settings whose documentation gives infinity a meaning."""


STAGES = [(preset, stage) for preset in engine_preset_names() for stage in stage_models(preset)]
OFFERS = [offer for offer in list_backends() if offer.distribution.startswith("physic-")]


def extremes(model):
    """The path of each numeric setting of a model, with its least and with its greatest value."""
    schema = model.model_json_schema()
    for name, field in schema["properties"].items():
        yield from of_field(field, schema.get("$defs", {}), (name,))


def of_field(field, parts, path):
    if "$ref" in field:
        field = parts[field["$ref"].rpartition("/")[2]]
    for alternative in field.get("anyOf", []):
        yield from of_field(alternative, parts, path)
    if field.get("type") == "object":
        for name, inner in field.get("properties", {}).items():
            yield from of_field(inner, parts, (*path, name))
    elif (
        "enum" not in field
        and "const" not in field
        and field.get("type") in ("integer", "number", "array")
    ):
        for greatest in (False, True):
            yield path, extreme(field, greatest)


def extreme(field, greatest):
    """The least or the greatest value that a JSON Schema allows; of a list, the shortest or the
    longest one.
    """
    if "enum" in field:
        return field["enum"][-1 if greatest else 0]
    if field["type"] == "array":
        if "prefixItems" in field:
            return [extreme(item, greatest) for item in field["prefixItems"]]
        return [extreme(field["items"], greatest)] * (
            field["maxItems"] if greatest else field.get("minItems", 0)
        )
    if greatest and "multipleOf" in field:
        return field["maximum"] // field["multipleOf"] * field["multipleOf"]
    if greatest:
        return (
            field.get("maximum", math.inf)
            if "exclusiveMaximum" not in field
            else below(field["exclusiveMaximum"])
        )
    return field["minimum"] if "minimum" in field else -below(-field["exclusiveMinimum"])


def below(bound):
    return math.nextafter(bound, -math.inf)


def numbers(value):
    return [n for item in value for n in numbers(item)] if isinstance(value, list) else [value]


@pytest.mark.parametrize("model", [PhotoSettings, RunSettings])
def test_every_setting_of_photo_and_run_is_bounded(model):
    check_bounds(model)


@pytest.mark.parametrize(("preset", "stage"), STAGES)
def test_every_setting_of_the_engine_is_bounded(preset, stage):
    check_bounds(stage_models(preset)[stage])


@pytest.mark.parametrize("offer", OFFERS, ids=str)
def test_every_option_is_bounded(offer):
    check_bounds(load_class(offer).Options)


def check_bounds(model):
    for path, value in extremes(model):
        assert path[-1] in INFINITE or all(
            isinstance(n, str) or math.isfinite(n) for n in numbers(value)
        ), path
        if model is PhotoSettings:  # its settings need each other
            continue
        table = value
        for key in reversed(path[1:]):
            table = {key: table}
        try:
            model.model_validate({path[0]: table})
        except ValueError as error:
            pytest.fail(f"{'.'.join(path)} = {json.dumps(value)[:100]}: {error}")


@pytest.mark.parametrize(
    ("name", "one"),
    [("stature", 1.7), ("age", 30), ("person", (1, 2)), ("ignore", (1, 2)), ("box", (1, 2, 3, 4))],
)
def test_a_photo_has_at_most_a_thousand_entries_of_each_kind(name, one):
    assert PhotoSettings.model_validate({name: [one] * 1000})
    with pytest.raises(ValueError, match="at most 1000"):
        PhotoSettings.model_validate({name: [one] * 1001})
