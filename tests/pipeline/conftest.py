from __future__ import annotations

import pytest

from physic_testing.worlds import load_world


@pytest.fixture(scope="session")
def world():
    """A small photo of one person who stands."""
    return load_world("stand", (160, 120))
