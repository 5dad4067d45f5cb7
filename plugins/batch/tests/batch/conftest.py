from __future__ import annotations

from pathlib import Path

import pytest

STANDIN = Path(__file__).parent / "standin"


@pytest.fixture
def standin(monkeypatch):
    """The module with workers that need no network; worker processes find it on the same path."""
    monkeypatch.syspath_prepend(STANDIN)
    import batch_standin

    return batch_standin
