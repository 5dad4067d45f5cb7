"""Numbers that JSON cannot write."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from physic_core.errors import InputError
from physic_core.files.text import from_json, parse_json, parse_toml, to_json

pytestmark = pytest.mark.quick


def test_nan_and_infinities_are_written_by_name_and_read_back():
    value = {"a": [math.nan, math.inf], "b": {"c": -math.inf, "d": 0.1, "e": "NaN?"}}
    assert to_json(value) == {
        "a": ["NaN", "Infinity"],
        "b": {"c": "-Infinity", "d": 0.1, "e": "NaN?"},
    }
    assert repr(from_json(json.loads(json.dumps(to_json(value), allow_nan=False)))) == repr(value)


def test_arrays_scalars_paths_and_keys_become_types_of_json():
    value = {
        1: np.float32(0.5),
        "b": np.arange(3),
        "c": (1, True),
        "d": Path("x/y"),
        "e": np.array([np.nan, 2.0]),
    }
    assert to_json(value) == {
        "1": 0.5,
        "b": [0, 1, 2],
        "c": [1, True],
        "d": "x/y",
        "e": ["NaN", 2.0],
    }
    assert type(to_json(np.float64(2.0))) is float


def test_floats_can_be_rounded_to_significant_digits():
    assert to_json([1234.5678, 1 / 3, 12345678, math.nan], digits=3) == [
        1230.0,
        0.333,
        12345678,
        "NaN",
    ]


@pytest.mark.parametrize("depth", [300, 5000])
@pytest.mark.parametrize(("parse", "form"), [(parse_json, "{}"), (parse_toml, "a = {}")])
def test_values_nested_too_deep_are_one_sentence(parse, form, depth):
    with pytest.raises(ValueError, match="more than 200 deep"):
        parse(form.format("[" * depth + "]" * depth))
    parse(form.format("[" * 100 + "]" * 100))


def test_a_key_that_an_object_has_twice_is_refused():
    with pytest.raises(ValueError, match="twice"):
        parse_json('{"a": [{"b": 1, "b": 2}]}')


def test_a_message_is_short_and_has_no_addresses():
    message = str(
        InputError(f"no image <_io.BytesIO object at 0x7fbee2030e00>: {'x' * 50_000}; end")
    )
    assert len(message) < 6000
    assert message.startswith("no image <_io.BytesIO object>: x")
    assert message.endswith("x; end")


@pytest.mark.parametrize("number", [f"1{'0' * 400}", f"-1{'0' * 400}", "1e400", "NaN", "Infinity"])
def test_a_number_that_no_float_holds_is_refused(number):
    with pytest.raises(ValueError, match="number"):
        parse_json(f'{{"a": [{number}]}}')
