"""The room with two mannequins, which tests of the core's files use too, and a saved result."""

from __future__ import annotations

import pytest

from physic_core import Reconstruction


@pytest.fixture(scope="session")
def rooms(module_at):
    """The module that makes the room."""
    return module_at("tests/conftest.py")


@pytest.fixture
def make(rooms):
    return rooms.make_reconstruction


@pytest.fixture
def reconstruction(rooms):
    return rooms.make_reconstruction()


@pytest.fixture(scope="session")
def result(saved_pair):
    """The saved result whose files are tested."""
    return Reconstruction.load(str(saved_pair))
