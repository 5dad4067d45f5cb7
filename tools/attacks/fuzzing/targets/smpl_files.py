"""Files of body models: the arrays of the layout, or BodyModelError."""

from __future__ import annotations

import io
import pickle
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from scipy.sparse import csc_matrix

from fuzzing.target import Target
from physic_core.body.files import MANO, SMPLX, load_smplx, read_model_file
from physic_core.errors import BodyModelError


@cache
def model_files() -> list[bytes]:
    """Made-up MANO files: pickles of each protocol and archives."""
    rng = np.random.default_rng(0)
    parents = [2**32 - 1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14]
    arrays = {
        "f": rng.integers(0, 778, (1538, 3)).astype(np.uint16),
        "kintree_table": np.array([parents, range(16)], np.uint32),
        "hands_components": np.eye(45, dtype=np.float16),
        "hands_mean": np.zeros(45, np.float16),
        "v_template": np.zeros((778, 3), np.float16),
        "shapedirs": np.zeros((778, 3, 10), np.float16),
        "J_regressor": np.eye(16, 778, dtype=np.float16),
        "weights": np.zeros((778, 16), np.float16),
        "posedirs": np.zeros((778, 3, 135), np.float16),
    }
    sparse = arrays | {"J_regressor": csc_matrix(arrays["J_regressor"].astype(np.float32))}
    files = [pickle.dumps(sparse, protocol) for protocol in range(2, 6)]
    for save in (np.savez, np.savez_compressed):
        file = io.BytesIO()
        save(file, **arrays)
        files.append(file.getvalue())
    return files


@cache
def undamaged() -> dict[str, np.ndarray]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "MANO_RIGHT.pkl")
        path.write_bytes(model_files()[-1])
        return dict(read_model_file(path, MANO))


@cache
def smplx_files() -> list[bytes]:
    """Archives with the names and shapes of SMPL-X, without the largest array."""
    arrays = {
        name: np.zeros([20 if n is None else n for n in shape], np.float16)
        for name, shape in SMPLX.shapes.items()
        if name != "posedirs"
    }
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return [file.getvalue()]


def attack_model(data: bytes, folder: Path) -> None:
    path = folder / "MANO_RIGHT.pkl"
    path.write_bytes(data)
    try:
        arrays = read_model_file(path, MANO)
    except BodyModelError as error:
        check_message(error, path)
        return
    for name, shape in MANO.shapes.items():
        assert all(
            wanted in (None, size) for wanted, size in zip(shape, arrays[name].shape, strict=True)
        )
        assert np.isfinite(arrays[name]).all()
        # A pickle has no checksums, so its numbers can be any.
        assert not data.startswith(b"PK") or np.array_equal(arrays[name], undamaged()[name]), name


def attack_smplx(data: bytes, folder: Path) -> None:
    path = folder / "SMPLX_NEUTRAL.npz"
    path.write_bytes(data)
    try:
        load_smplx(path)
    except BodyModelError as error:
        check_message(error, path)
        return
    raise AssertionError("a file without posedirs was read")


def check_message(error: BodyModelError, path: Path) -> None:
    message = str(error)
    if str(path) not in message or not message.isprintable() or len(message) > 1000:
        raise AssertionError(
            f"the message is not of one short line with the path: {message!r}"
        ) from error


TARGETS = [
    Target("smpl_files", lambda folder: model_files(), attack_model),
    Target("smplx_files", lambda folder: smplx_files(), attack_smplx),
]
