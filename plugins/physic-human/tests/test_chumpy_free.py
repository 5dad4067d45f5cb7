"""Copies of body models for code that unpickles them: what it finds in them, and how long they exist."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core.errors import BodyModelError
from physic_human.hands import chumpy_free_copy
from physic_testing.body_files import mano_arrays, write_published


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


def test_the_published_file_cannot_be_unpickled_here_and_its_copy_can(mano: Path) -> None:
    with pytest.raises(ModuleNotFoundError, match="No module named 'chumpy'"):
        unpickled(mano)
    with chumpy_free_copy(str(mano), "mano") as copy:
        require_same(unpickled(copy), mano_arrays())
        assert copy.name == "MANO_RIGHT.pkl", "smplx tells right hands by this name"


def test_a_copy_exists_only_inside_the_block_and_for_its_user_alone(
    mano: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path / "kept"))
    with chumpy_free_copy(mano, "mano") as copy:
        assert os.name != "posix" or copy.parent.stat().st_mode & 0o077 == 0
    assert not copy.parent.exists()
    assert not (tmp_path / "kept").exists()


class Runs:
    def __reduce__(self) -> tuple[Any, ...]:
        return pytest.fail, ("the pickle was run",)


def test_a_file_that_would_run_code_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "MANO_RIGHT.pkl"
    path.write_bytes(pickle.dumps({**mano_arrays(), "bs_type": Runs()}))
    with pytest.raises(BodyModelError, match="could run code: it is not opened"), chumpy_free_copy(path, "mano"):
        pass


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    path = tmp_path / "MANO_RIGHT.pkl"
    with pytest.raises(BodyModelError) as caught, chumpy_free_copy(path, "mano"):
        pass
    assert f"no body model file {path}" in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(mano: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, *arguments: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(BodyModelError) as caught, chumpy_free_copy(mano, "mano"):
        pass
    assert f"{mano} cannot be read (Permission denied)" in str(caught.value)
