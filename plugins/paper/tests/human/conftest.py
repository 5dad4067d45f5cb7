"""Stub checkouts and files with the contracts of the published ones."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_testing.body_files import smpl_arrays


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def stub(tmp_path):
    """Write a checkout, files by their path, and return its folder."""

    def write(name, files):
        folder = tmp_path / name
        for path, text in files.items():
            place = folder / path
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text)
        return folder

    return write


@pytest.fixture(scope="session")
def smpl_file(tmp_path_factory):
    """A made-up SMPL file."""
    path = tmp_path_factory.mktemp("smpl") / "SMPL_NEUTRAL.npz"
    np.savez(path, **smpl_arrays())
    return path


def reading(backend, folder):
    """The backend, with its weights in this folder."""
    backend.file = lambda name=None: folder / name if name else folder
    return backend
