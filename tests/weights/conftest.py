from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder for caches and one of Hugging Face's, both of the test alone; no folder of the user's own."""
    from huggingface_hub import constants

    monkeypatch.delenv("PHYSIC_WEIGHTS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    return tmp_path / "cache" / "physic" / "weights"


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


class Lists:
    """A plugin's folder of TOML files, written table by table."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()

    def add(self, name: str, *files: dict[str, Any], **keys: Any) -> Path:
        """Add a set in a file of its own; return the folder."""
        keys = {"summary": f"The {name} weights", "license": "MIT", "commercial": True} | keys
        lines = [f'["{name}"]', *(f"{key} = {_toml(v)}" for key, v in keys.items() if v is not None)]
        for file in files:
            lines += [f'[["{name}".files]]', *(f"{key} = {_toml(v)}" for key, v in file.items())]
        (self.folder / f"{name}.toml").write_text("\n".join(lines) + "\n")
        return self.folder


def _toml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)


@pytest.fixture
def lists(tmp_path: Path) -> Lists:
    return Lists(tmp_path / "lists")
