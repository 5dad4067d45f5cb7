"""Convert a user's SMPL or MANO file to plain NumPy arrays, for published code that unpickles such files.

The published pickles need chumpy, which does not work with new versions of Python. Unpickling a file can run any code
in it. So such code gets a copy that contains only NumPy arrays.
"""

from __future__ import annotations

import os
import pickle
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal


@contextmanager
def chumpy_free_copy(path: str | Path, family: Literal["smpl", "mano"]) -> Iterator[Path]:
    """Yield the path of a chumpy-free copy of a body model, for ``pickle.load(file, encoding="latin1")`` and smplx.

    The copy exists only inside the block, in a new folder that only the user can open. It is a pickle, so it is not
    cached. It has the name of the original, by which smplx tells right hands.

    Args:
        path: the user's file, a published ``.pkl`` or ``.npz``.
        family: type of the model.

    Raises:
        BodyModelError: the file is missing, has another type, is damaged, or could run code.
    """
    from physic_core.body.files.model_file import MANO, SMPL, read_model_file

    source = Path(os.path.expanduser(path))
    arrays = {
        name: array.astype(array.dtype.newbyteorder("="), order="C")
        for name, array in read_model_file(source, MANO if family == "mano" else SMPL).items()
    }
    with tempfile.TemporaryDirectory(prefix="physic-") as folder:
        copy = Path(folder, f"{source.stem}.pkl")
        copy.write_bytes(pickle.dumps(arrays, protocol=4))
        yield copy
