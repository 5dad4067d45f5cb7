"""Model files made from the embedded body."""

from __future__ import annotations

import pytest

from .miniatures import write_models


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """Files of the size and layout of SMPLX_{NEUTRAL,MALE}.npz and SMPL_NEUTRAL.pkl; male is larger
    than neutral.
    """
    return write_models(tmp_path_factory.mktemp("models"))


@pytest.fixture
def root(tmp_path):
    """A folder for the photos of worlds."""
    return tmp_path / "worlds"
