"""Keeps built worlds and settled performances on disk, so that each is built once per machine.

Files lie in ``$XDG_CACHE_HOME/physic/worlds``, or in the system's own place for caches. Set ``PHYSIC_WORLD_CACHE`` to
another folder, or to "off". A file that cannot be read is built anew; a disk that cannot be written costs time only.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from physic_core.errors import OutputError
from physic_core.io.atomic import replacing
from physic_core.testing.archive import pack, unpack

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

__all__ = ["BYTES", "SWITCH", "VERSION", "folder", "kept", "key_of"]

T = TypeVar("T")

VERSION = 1
"""To be raised when the same name, seed and size mean another world for a reason outside ``physic_core.testing``."""

SWITCH = "PHYSIC_WORLD_CACHE"
"""Environment variable: a folder, or "off"."""

BYTES = 3 << 30
"""What all files together may take; those unused for longest go first."""

_SUFFIX, _DOCUMENT = ".npz", "document"


def folder() -> Path | None:
    """Where worlds are kept, or None if they are not."""
    wish = os.environ.get(SWITCH, "")
    if wish.lower() in ("off", "0", "no", "false"):
        return None
    if wish:
        return Path(wish)
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # the standard says that a relative one is not valid
        if sys.platform == "win32":
            base = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
        else:
            base = str(Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache"))
    return Path(base) / "physic" / "worlds"


def key_of(*parts: str | int, without: tuple[str, ...] = ()) -> str:
    """A file name for what these parts name, with a digest of what builds it.

    Args:
        parts: name it.
        without: modules of ``physic_core.testing`` that it does not depend on.
    """
    return "-".join(str(part) for part in (*parts, _builder(without)))


def kept(key: str, kind: type[T], classes: Iterable[type], build: Callable[[], T]) -> T:
    """What is kept under a key, or else what ``build`` answers, which is then kept.

    Args:
        key: of ``key_of``.
        kind: the dataclass that is kept.
        classes: other dataclasses in it.
        build: builds it.
    """
    place = folder()
    if place is None:
        return build()
    found = _load(place / (key + _SUFFIX), kind, (kind, *classes))
    if found is None:
        found = build()
        # A disk that cannot be written costs time, no more.
        with suppress(OSError, OutputError):
            _save(place, key + _SUFFIX, found)
    return found


def _load(path: Path, kind: type[T], classes: Iterable[type]) -> T | None:
    try:
        # Opened here: of a broken archive numpy forgets to close the file.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        thing = unpack(arrays, json.loads(arrays.pop(_DOCUMENT).tobytes()), classes)
    except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile, zlib.error):
        return None  # not there, or not whole: built anew
    with suppress(OSError):
        os.utime(path)  # what was used lately is kept longest
    return thing if isinstance(thing, kind) else None


def _save(place: Path, name: str, thing: object) -> None:
    arrays, document = pack(thing)
    arrays[_DOCUMENT] = np.frombuffer(json.dumps(document).encode(), np.uint8)
    place.mkdir(parents=True, exist_ok=True)
    with replacing(place) as temporary:
        _write(temporary(name), arrays)
    _shrink(place)


def _write(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """An npz whose parts are lightly compressed: half the time of numpy's own for nearly the same size."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)


def _shrink(place: Path) -> None:
    files = []
    for path in place.glob(f"*{_SUFFIX}"):
        with suppress(OSError):
            status = path.stat()
            files.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in files)
    for _, size, path in sorted(files):
        if total <= BYTES:
            break
        with suppress(OSError):
            path.unlink()
        total -= size


@cache
def _builder(without: tuple[str, ...]) -> str:
    """A digest of this version, the sources of ``physic_core.testing``, and the body."""
    digest = hashlib.sha256(f"{VERSION}".encode())
    here = Path(__file__).parent
    sources = [path for path in sorted(here.glob("*.py")) if path.stem not in without]
    for path in (*sources, here.parent / "body" / "embedded.sha256"):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
