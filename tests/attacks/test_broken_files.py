"""Files that once broke a reader are refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from physic_core import load_reconstruction, save_reconstruction
from physic_core.body.files import MANO, load_smplx, read_model_file
from physic_core.errors import BackendError, BodyModelError, InputError
from physic_core.weights.manifest import read_manifest
from tests.rooms import tiny_result

CORPUS = Path(__file__).parent / "corpus"


def test_files_that_once_broke_a_reader_are_refused(tmp_path):
    save_reconstruction(tiny_result(), tmp_path, "numbers")
    shutil.copy(CORPUS / "long-header.npz", tmp_path / "reconstruction.npz")
    with pytest.raises(InputError):
        load_reconstruction(tmp_path)
    with pytest.raises(BodyModelError):
        read_model_file(CORPUS / "MANO_RIGHT.pkl", MANO)
    for name in ("MANO_RIGHT.pkl", "SMPLX_NEUTRAL.npz"):
        shutil.copy(CORPUS / name, tmp_path / "SMPLX_NEUTRAL.npz")
        with pytest.raises(BodyModelError):
            load_smplx(tmp_path / "SMPLX_NEUTRAL.npz")
    with pytest.raises(BackendError):
        read_manifest(CORPUS / "weights.toml")
