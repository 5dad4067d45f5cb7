from __future__ import annotations

import pytest


@pytest.fixture
def root(tmp_path, monkeypatch):
    """The user's cache, which is not there yet."""
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path / "new" / "cache"))
    return tmp_path / "new" / "cache"
