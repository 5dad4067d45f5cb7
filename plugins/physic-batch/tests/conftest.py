from __future__ import annotations

import sys
from pathlib import Path

import pytest

STANDIN = Path(__file__).parent / "standin"
# ``tiny_result``, which has a result without any estimator.
sys.path.insert(0, str(Path(__file__).parents[3] / "tests" / "attacks"))


@pytest.fixture
def standin(monkeypatch):
    """The module with workers that need no network; worker processes find it on the same path."""
    monkeypatch.syspath_prepend(STANDIN)
    import batch_standin

    return batch_standin


@pytest.fixture(scope="session")
def make(module_at):
    """Make a room with mannequins: ``make(width, height, people)``."""
    return module_at("tests/conftest.py").make_reconstruction
