from __future__ import annotations

import pytest

from physic_testing.worlds import World, build_world


@pytest.fixture(scope="session")
def world() -> World:
    """A small photo of one person who stands."""
    return build_world("stand", 0, (160, 120))
