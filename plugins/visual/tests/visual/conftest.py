"""A saved result."""

from __future__ import annotations

import pytest

from physic_core import Reconstruction


@pytest.fixture(scope="session")
def result(saved_pair):
    """The saved result whose files are tested."""
    return Reconstruction.load(str(saved_pair))
