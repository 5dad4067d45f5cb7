"""Convert a user's SMPL or MANO file to plain NumPy arrays, for published code that unpickles such files.

The published pickles need chumpy, which does not work with new versions of Python. Unpickling a file can run any code
in it. So such code gets a copy that contains only NumPy arrays.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from physic_core.errors import BodyModelError, OutputError

if TYPE_CHECKING:
    from physic_core.body.model_file import ModelFileLayout

__all__ = ["chumpy_free_copy"]

_VERSION = "1"
_DIGEST = 32
"""Bytes of the checksum after the pickle; ``pickle.load`` stops before them."""


@contextmanager
def chumpy_free_copy(path: str | Path, family: Literal["smpl", "mano"]) -> Iterator[Path]:
    """Yield the path of a chumpy-free copy of a body model, for ``pickle.load(file, encoding="latin1")`` and smplx.

    The copy is cached (``physic cache clear`` removes it). It is verified before each use, and written again if
    damaged. With the cache disabled it exists only inside the block. Its name starts like that of the original.

    Args:
        path: the user's file, a published ``.pkl`` or ``.npz``.
        family: type of the model.

    Raises:
        BodyModelError: the file is missing, has another type, is damaged, or could run code.
    """
    from physic_core.body.model_file import MANO, SMPL
    from physic_core.cache.folders import models_folder
    from physic_core.cache.lru_folder import MODEL_SUFFIX

    source, layout = Path(os.path.expanduser(path)), MANO if family == "mano" else SMPL
    digest = _digest(source, layout)
    name = f"{_safe_name(source.stem)}-{digest[:24]}{MODEL_SUFFIX}"
    folder = models_folder()
    if folder is not None and (_is_valid(folder / name, digest) or _write(folder, name, source, layout, digest)):
        yield (folder / name).absolute()
        return
    with tempfile.TemporaryDirectory(prefix="physic-") as temporary:
        copy = Path(temporary) / name
        copy.write_bytes(_content(source, layout, digest))
        yield copy


def _digest(source: Path, layout: ModelFileLayout) -> str:
    """Return a hash of the source file's content and family, as the name of its copy."""
    if source.exists() and not source.is_file():  # a pipe would wait for ever, and a device never ends
        raise BodyModelError(f"the body model file {source} cannot be read (it is not a regular file): {layout.advice}")
    try:
        with source.open("rb") as stream:
            content = hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise BodyModelError(
            f"the body model file {source} cannot be read ({error.strerror or error}): {layout.advice}"
        ) from error
    return hashlib.sha256(f"{_VERSION} {layout.name} {content}".encode()).hexdigest()


def _is_valid(copy: Path, digest: str) -> bool:
    """Return whether a copy exists and matches its checksum."""
    try:
        content = copy.read_bytes()
    except OSError:
        return False
    return content[-_DIGEST:] == _checksum(content[:-_DIGEST], digest)


def _write(folder: Path, name: str, source: Path, layout: ModelFileLayout, digest: str) -> bool:
    """Write the copy to the cache; return False if that fails."""
    from physic_core.files.atomic import atomic_write

    content = _content(source, layout, digest)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder) as temporary:
            temporary(name).write_bytes(content)
    except (OSError, OutputError):
        return False
    return True


def _content(source: Path, layout: ModelFileLayout, digest: str) -> bytes:
    """Return the copy as bytes: a pickle of NumPy arrays, then a checksum."""
    from physic_core.body.model_file import read_model_file

    arrays = {
        name: array.astype(array.dtype.newbyteorder("="), order="C")
        for name, array in read_model_file(source, layout).items()
    }
    content = pickle.dumps(arrays, protocol=4)
    return content + _checksum(content, digest)


def _checksum(content: bytes, digest: str) -> bytes:
    """Return the SHA-256 of a digest and the content."""
    return hashlib.sha256(digest.encode() + content).digest()


def _safe_name(name: str) -> str:
    """Return a file name of at most 40 letters, digits, "-" and "_"."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)[:40]
