"""Values as JSON and arrays: restored by the types of their fields, and files that are complete or
refused.
"""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from physic_core.files.serialization import DamagedFileError, join, read_value, split, write_value
from physic_core.types.arrays import shape

pytestmark = pytest.mark.quick


class Colour(StrEnum):
    RED = "red"


@dataclass(frozen=True)
class Inner:
    table: NDArray[np.float32] = field(metadata=shape("N", 2))
    number: float | None = None


@dataclass(frozen=True)
class Value:
    mask: NDArray[np.bool_] = field(metadata=shape("N"))
    inner: tuple[Inner, ...]
    by_name: Mapping[int, Inner]
    place: tuple[float, float]
    name: str = "NaN"
    colour: Colour | None = None
    side: Literal["left", "right"] = "left"
    point: Inner | str = ""
    anything: Any = None
    skipped: int = field(default=0, metadata={"stored": False})


VALUE = Value(
    np.array([True, False, True]),
    (
        Inner(np.arange(6, dtype=np.float32).reshape(3, 2), math.inf),
        Inner(np.ones((3, 2), np.float32)),
    ),
    {7: Inner(np.zeros((3, 2), np.float32), -0.0)},
    (math.nan, 2.0),
    colour=Colour.RED,
    point=Inner(np.full((3, 2), np.nan, np.float32), 1 / 3),
    anything={"a": [1, "b", None, math.inf], "array": np.arange(3)},
)


def stored(value):
    arrays = {}
    return json.loads(json.dumps(split(value, arrays), allow_nan=False)), arrays


@pytest.mark.parametrize("value", [[None], [], {}])
def test_a_field_that_may_be_none_takes_no_other_value(value):
    with pytest.raises(TypeError):
        join(float | None, value, {})


def test_a_value_is_restored_by_the_types_of_its_fields():
    document, arrays = stored(replace(VALUE, skipped=3))
    assert (
        " ".join(arrays)
        == "mask inner.0.table inner.1.table by_name.7.table point.table anything.array"
    )
    assert repr(join(Value, document, arrays)) == repr(VALUE)
    assert document["name"] == "NaN"
    assert "mask" not in document


@pytest.mark.parametrize(
    ("entries", "new_arrays"),
    [
        ({"name": 7}, {}),
        ({"place": [1.0]}, {}),
        ({"place": [True, 1.0]}, {}),
        ({"colour": "blue"}, {}),
        ({"side": "up"}, {}),
        ({"inner": [{"number": "x"}]}, {}),
        ({}, {"mask": np.ones(3, np.uint8)}),
        ({}, {"inner.1.table": np.ones((3, 2, 1), np.float32)}),
        ({}, {"inner.1.table": np.ones((3, 2), ">f4")}),
        ({}, {"inner.1.table": None}),
        ({}, {"name": np.ones(3)}),
    ],
)
def test_a_value_that_does_not_fit_its_field_is_refused(entries, new_arrays):
    document, arrays = stored(VALUE)
    arrays = {name: array for name, array in (arrays | new_arrays).items() if array is not None}
    with pytest.raises((TypeError, ValueError)):
        join(Value, document | entries, arrays)


def test_an_object_of_another_class_is_not_stored():
    with pytest.raises(TypeError, match=r"anything\.0 is a set"):
        stored(replace(VALUE, anything=[{1, 2}]))


def test_a_file_reads_back_as_it_was_written(tmp_path):
    path = tmp_path / "new" / "a.npz"
    write_value(path, VALUE, {"name": "a"})
    assert repr(read_value(path, [Value, Inner], {"name": "a"})) == repr(VALUE)
    assert [one.name for one in path.parent.iterdir()] == ["a.npz"]
    with pytest.raises(DamagedFileError, match="name is 'a'"):
        read_value(path, [Value], {"name": "b"})
    with pytest.raises(DamagedFileError, match="Value"):
        read_value(path, [Inner])
    write_value(tmp_path / "b.npz", VALUE, {"name": "a"})
    assert (tmp_path / "b.npz").read_bytes() == path.read_bytes()
    with pytest.raises(FileNotFoundError):
        read_value(tmp_path / "c.npz", [Value])


def test_every_flipped_byte_and_every_cut_is_noticed_or_harmless(tmp_path):
    write_value(tmp_path / "a.npz", VALUE)
    whole = (tmp_path / "a.npz").read_bytes()
    broken = tmp_path / "b.npz"
    refused = 0
    for i in range(0, len(whole), 5):
        broken.write_bytes(whole[:i] + bytes([whole[i] ^ (1 << i % 8)]) + whole[i + 1 :])
        try:
            assert repr(read_value(broken, [Value])) == repr(VALUE)
        except DamagedFileError:
            refused += 1
        broken.write_bytes(whole[:i])
        with pytest.raises(DamagedFileError):
            read_value(broken, [Value])
    assert refused > len(whole) / 20


def test_a_pickle_is_never_opened(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was opened",))

    np.savez(tmp_path / "a.npz", document=np.array([Bomb()], object))
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Bomb()))
    for name in ("a.npz", "b.npz"):
        with pytest.raises(DamagedFileError):
            read_value(tmp_path / name, [Value])
