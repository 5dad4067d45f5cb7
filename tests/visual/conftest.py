"""The saved result whose files are tested."""

from __future__ import annotations

from pathlib import Path

import pytest

from physic_core import Reconstruction


@pytest.fixture(scope="session")
def result(saved_pair: Path) -> Reconstruction:
    return Reconstruction.load(str(saved_pair))
