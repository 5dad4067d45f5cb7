"""Convert a user's SMPL or MANO file to plain NumPy arrays, for published code that unpickles it.

The published pickles need chumpy, which does not work with new versions of Python. Unpickling a file can run any code
in it. So such code gets a copy that contains only NumPy arrays.
"""

from __future__ import annotations

import hashlib
import pickle
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from physic_core.errors import BodyModelError, OutputError

if TYPE_CHECKING:
    from physic_core.body.model_file import Layout

__all__ = ["plain_model"]

_VERSION = "1"
_DIGEST = 32
"""Bytes of the checksum behind a copy; ``pickle.load`` stops before them."""


@contextmanager
def plain_model(path: str | Path, family: Literal["smpl", "mano"]) -> Iterator[Path]:
    """Yield the path of a converted body model, for ``pickle.load(file, encoding="latin1")`` and smplx.

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

    source, layout = Path(path).expanduser(), MANO if family == "mano" else SMPL
    digest = _digest(source, layout)
    name = f"{_plain(source.stem)}-{digest[:24]}{MODEL_SUFFIX}"
    folder = models_folder()
    if folder is not None and (_is_whole(folder / name, digest) or _keep(folder, name, source, layout, digest)):
        yield (folder / name).absolute()
        return
    with tempfile.TemporaryDirectory(prefix="physic-") as temporary:
        copy = Path(temporary) / name
        copy.write_bytes(_content(source, layout, digest))
        yield copy


def _digest(source: Path, layout: Layout) -> str:
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


def _is_whole(copy: Path, digest: str) -> bool:
    try:
        content = copy.read_bytes()
    except OSError:
        return False
    return content[-_DIGEST:] == _checksum(content[:-_DIGEST], digest)


def _keep(folder: Path, name: str, source: Path, layout: Layout, digest: str) -> bool:
    """Write the copy to the cache; False if that fails."""
    from physic_core.files.atomic import atomic_write

    content = _content(source, layout, digest)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder) as temporary:
            temporary(name).write_bytes(content)
    except (OSError, OutputError):
        return False
    return True


def _content(source: Path, layout: Layout, digest: str) -> bytes:
    from physic_core.body.model_file import read_model

    arrays = {
        name: array.astype(array.dtype.newbyteorder("="), order="C")
        for name, array in read_model(source, layout).items()
    }
    content = pickle.dumps(arrays, protocol=4)
    return content + _checksum(content, digest)


def _checksum(content: bytes, digest: str) -> bytes:
    return hashlib.sha256(digest.encode() + content).digest()


def _plain(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)[:40]
