"""File names and digests of a result folder, and a check that no user file is overwritten."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.errors import OutputError
from physic_core.files.atomic import interrupted_index_files
from physic_core.files.regular import read_regular
from physic_core.files.strict_json import parse_json

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

SCHEMA = "physic-reconstruction"
DOCUMENT_FILE = "reconstruction.json"
ARRAYS_FILE = "reconstruction.npz"
PREVIEW_FILE = "preview.png"
REPORT_FILE = "report.html"
PEOPLE_FILE = "people.npz"
PEOPLE_TABLE = "people.csv"
MAX_DOCUMENT_BYTES = 64 << 20
_FIXED = (DOCUMENT_FILE, ARRAYS_FILE, PEOPLE_FILE, PEOPLE_TABLE, PREVIEW_FILE, REPORT_FILE, "scene.glb", "combined.glb")
_PERSON = re.compile(r"person_[0-9]+\.glb")


def file_digest(source: str | os.PathLike[str] | BufferedReader) -> str:
    """Compute the SHA-256 of a file, given by its path or open at its start; "" if it cannot be read."""
    with suppress(OSError, ValueError):
        if not isinstance(source, str | os.PathLike):
            return f"sha256:{hashlib.file_digest(source, 'sha256').hexdigest()}"
        if os.path.isfile(source):  # reading a pipe would block
            with open(source, "rb") as file:
                return file_digest(file)
    return ""


def digest_of(content: bytes) -> str:
    """Compute the SHA-256 of the content of a file, in the form of :func:`file_digest`."""
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def image_digest(image: UInt8Array) -> str:
    """Compute the SHA-256 of the pixels of an image."""
    shape = "x".join(map(str, image.shape))
    return f"pixels-sha256:{hashlib.sha256(shape.encode() + image.tobytes()).hexdigest()}"


def same_photo(one: str, other: str) -> bool:
    """Whether two results have a photo in common, by the digests of their photos, separated by spaces."""
    return one == other or not set(one.split()).isdisjoint(other.split())


def photo_identity_of_result(folder: str | os.PathLike[str]) -> str | None:
    """Read the digests of the photo from the result in a folder; None if there is no result."""
    document = _document(Path(folder))
    return None if document is None else str(document.get("photo", ""))


def digests_of_result(folder: str | os.PathLike[str]) -> dict[str, str]:
    """Read the digests of the files of a result; none if there is no result."""
    return _digests(_document(Path(folder)) or {})


def earlier_files(folder: str | os.PathLike[str], earlier: Iterable[str] = ()) -> tuple[frozenset[str], frozenset[str]]:
    """Return the names of the files in a folder that an earlier run wrote: unchanged ones, and edited ones.

    The run may have been killed while writing them. A file with another digest, a link or a folder under such a name is
    edited: it belongs to the user. The document belongs to the run, even if it was edited.

    Args:
        folder: of a result.
        earlier: names that an earlier run wrote, even if no document lists them.
    """
    folder = Path(folder)
    documents = _documents(folder)

    def is_unchanged(name: str) -> bool:
        if os.path.islink(folder / name):
            return False
        if name == DOCUMENT_FILE:
            return _document(folder) is not None
        return file_digest(folder / name) in {_digests(document).get(name, "missing") for document in documents}

    # A document of others can list a name that no file can have: of such a one, lexists is false.
    there = {name for name in (*_files(*documents), *earlier) if os.path.lexists(folder / name)}
    unchanged = frozenset(filter(is_unchanged, there))
    return unchanged, frozenset(there - unchanged)


def check_overwrite(
    folder: str | os.PathLike[str],
    photo: str,
    *,
    overwrite: bool = False,
    names: Iterable[str] | None = None,
    earlier: Iterable[str] = (),
) -> None:
    """Raise OutputError if writing a result to a folder would overwrite user data.

    Args:
        folder: where the result will be written.
        photo: digests of its photo.
        overwrite: allow replacing the result of another photo.
        names: of the files that will be written; None for all possible files of a result.
        earlier: names that an earlier run wrote, even if no document lists them.

    Raises:
        OutputError: a file with one of these names is the photo, or was not written by a run; the folder has the result
            of another photo.
    """
    folder = Path(folder)
    present = [name for name in (_names_in(folder) if names is None else names) if os.path.lexists(folder / name)]
    unchanged, edited = earlier_files(folder, earlier)
    photos = [name for name in present if file_digest(folder / name) in photo.split()]
    foreign = [name for name in present if name not in {*photos, *unchanged, *edited}]
    whose = photo_identity_of_result(folder)
    faults = [f"{_listed(photos)} there is the photo itself"] if photos else []
    if foreign:
        faults.append(f"{_listed(foreign)} there {'is' if len(foreign) == 1 else 'are'} not of an earlier run")
    lost = [*photos, *foreign]
    cure = f"move {'it' if len(lost) == 1 else 'them'} away"
    if whose is not None and not same_photo(whose, photo) and not overwrite:
        faults.append("it holds the result of another photo")
        cure = cure if lost else "replace that result with --overwrite (overwrite=True in Python)"
    if faults:
        raise OutputError(f"cannot write results to {folder}: {'; '.join(faults)}: name another folder, or {cure}")


def _names_in(folder: Path) -> list[str]:
    people: list[str] = []
    with suppress(OSError):
        people = sorted(entry.name for entry in folder.iterdir() if _PERSON.fullmatch(entry.name))
    return [*_FIXED, *people]


def _documents(folder: Path) -> list[dict[str, Any]]:
    """Read ``reconstruction.json`` of a folder, and those of runs that were killed while writing."""
    names = [DOCUMENT_FILE, *(path.name for path in interrupted_index_files(folder, DOCUMENT_FILE))]
    return [document for name in names if (document := _document(folder, name)) is not None]


def _document(folder: Path, name: str = DOCUMENT_FILE) -> dict[str, Any] | None:
    """Read ``reconstruction.json`` of a folder; None if it is missing or invalid."""
    try:
        document = parse_json(read_regular(folder / name, MAX_DOCUMENT_BYTES))
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and document.get("schema") == SCHEMA else None


def _digests(document: Mapping[str, Any]) -> dict[str, str]:
    digests = document.get("digests")
    return {name: str(digest) for name, digest in digests.items()} if isinstance(digests, dict) else {}


def _files(*documents: Mapping[str, Any]) -> frozenset[str]:
    lists = [document.get("files") for document in documents]
    named = [str(name) for files in lists if isinstance(files, list) for name in files]
    return frozenset(name for name in named if os.path.basename(name) == name)


def _listed(names: list[str]) -> str:
    return ", ".join(names)
