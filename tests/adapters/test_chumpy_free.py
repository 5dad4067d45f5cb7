"""Copies of body models: what a careless reader finds in them, where they are kept, and that none is used damaged."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core.adapters.chumpy_free import chumpy_free_copy
from physic_core.errors import BodyModelError
from physic_testing.body_files import mano_arrays, write_published


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


@pytest.fixture
def mano(tmp_path: Path) -> Path:
    return write_published(tmp_path / "MANO_RIGHT.pkl", mano_arrays())


def unpickled(path: Path) -> dict[str, Any]:
    """As smplx reads it."""
    with path.open("rb") as stream:
        found: dict[str, Any] = pickle.load(stream, encoding="latin1")
    return found


def require_same(found: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert type(found[name]) is np.ndarray
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def test_the_published_file_cannot_be_unpickled_here_and_its_copy_can(mano: Path, cache: Path) -> None:
    with pytest.raises(ModuleNotFoundError, match="No module named 'chumpy'"):
        unpickled(mano)
    with chumpy_free_copy(mano, "mano") as copy:
        require_same(unpickled(copy), mano_arrays())
        assert copy.name.startswith("MANO_RIGHT-"), "smplx tells right hands by this name"
    assert copy.parent == cache
    assert copy.is_file()


class Runs:
    def __reduce__(self) -> tuple[Any, ...]:
        return pytest.fail, ("the pickle was run",)


def test_a_file_that_would_run_code_is_refused(tmp_path: Path, cache: Path) -> None:
    path = tmp_path / "MANO_RIGHT.pkl"
    path.write_bytes(pickle.dumps({**mano_arrays(), "bs_type": Runs()}))
    with pytest.raises(BodyModelError, match="could run code: it is not opened"), chumpy_free_copy(path, "mano"):
        pass
    assert not cache.exists()


def test_a_copy_is_made_once(mano: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with chumpy_free_copy(mano, "mano") as first:
        pass
    monkeypatch.setattr("physic_core.body.model_file.read_model_file", lambda *_: pytest.fail("it was read again"))
    with chumpy_free_copy(str(mano), "mano") as second:
        assert second == first
    assert [path.name for path in cache.iterdir()] == [first.name]


@pytest.mark.parametrize("damage", ["a bit", "cut", "empty", "another"])
def test_a_damaged_copy_is_made_anew(damage: str, mano: Path, cache: Path) -> None:
    with chumpy_free_copy(mano, "mano") as copy:
        whole = copy.read_bytes()
    if damage == "another":  # whole in itself, and of another file
        write_published(mano.with_name("other.pkl"), {**mano_arrays(), "hands_mean": np.ones(45)})
        with chumpy_free_copy(mano.with_name("other.pkl"), "mano") as other:
            broken = other.read_bytes()
    else:
        broken = {"a bit": bytes([*whole[:5000], whole[5000] ^ 1, *whole[5001:]]), "cut": whole[:-1], "empty": b""}[
            damage
        ]
    copy.write_bytes(broken)
    with chumpy_free_copy(mano, "mano") as again:
        assert again == copy
        assert again.read_bytes() == whole


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    path = tmp_path / "MANO_RIGHT.pkl"
    with pytest.raises(BodyModelError) as caught, chumpy_free_copy(path, "mano"):
        pass
    assert str(caught.value) == (
        f"the body model file {path} cannot be read (No such file or directory): "
        "give the path of an official MANO file, MANO_RIGHT.pkl"
    )
