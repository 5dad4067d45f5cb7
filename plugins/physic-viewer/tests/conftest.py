"""The room with two mannequins, which tests of the core's files use too."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def rooms():
    """The module that makes the room."""
    path = Path(__file__).parents[3] / "tests" / "conftest.py"
    spec = spec_from_file_location("rooms", path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def make(rooms):
    return rooms.make_reconstruction


@pytest.fixture
def reconstruction(rooms):
    return rooms.make_reconstruction()
