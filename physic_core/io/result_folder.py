"""The folder of a result: new, empty, or that of an earlier result without a change; it is replaced
as a whole.

The document names the other files with their SHA-256, and its ``run`` is a digest of itself, so
that a file of the user is recognised. A new result is made in a hidden folder beside the old one,
and renamed. A process that is killed between the two renames leaves the old result hidden, which
the next run puts back. ``people.csv``, a row for each person, and ``report.html``, a page for a
browser, are beside document and arrays.
"""

from __future__ import annotations

import glob
import hashlib
import io
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.errors import InputError, OutputError
from physic_core.files.atomic import (
    atomic_write,
    check_writable,
    is_part,
    locked,
    open_regular,
    read_regular,
    refusal,
)
from physic_core.files.names import UntrustedName
from physic_core.files.text import parse_json, write_csv
from physic_core.types.tables import PERSON_COLUMNS, person_rows

if TYPE_CHECKING:
    from physic_core.types import Reconstruction, UInt8Array

SCHEMA = "physic-reconstruction"
DOCUMENT_FILE = "reconstruction.json"
ARRAYS_FILE = "reconstruction.npz"
PEOPLE_TABLE = "people.csv"
MAX_DOCUMENT_BYTES = 64 << 20
_SYSTEM_FILES = {".DS_Store", "Thumbs.db", "desktop.ini"}
_RUN = re.compile(
    rb'\{\s*"schema": "physic-reconstruction",\s*"schema_version": \d+,\s*"run": "(\w+)"'
)
_END_BYTES = 1000


def prepare_result_folder(
    folder: str | os.PathLike[str], photos: str, *, overwrite: bool = False
) -> None:
    """Create the folders above that of a result, and check that the result may be written; call it
    before anything is computed.

    An old result that a killed process has hidden is put back.

    Args:
        folder: of the result.
        photos: digests of the photo, or of all photos of a moment, separated by spaces.
        overwrite: whether the result of another photo may be replaced.

    Raises:
        OutputError: the folder cannot be written or renamed, has a file of the user, or has the
            result of another photo.
    """
    target = Path(os.path.realpath(folder))
    check_writable(target.parent)
    with _locked(target):
        with suppress(FileNotFoundError):
            os.lstat(_hidden(target, ".01234567.new"))  # its name may be too long
        if not os.path.lexists(target):
            return
        if reason := _reason_to_keep(target):
            raise OutputError(f"cannot write results to {folder}: {reason}; name another folder")
        _check_replaceable(target, target, photos, overwrite=overwrite)


def _reason_to_keep(target: Path) -> str:
    """Return why a folder cannot be replaced as a whole; "" if it can."""
    if not target.is_dir():
        return "it is a file"
    if os.path.ismount(target):
        return "it is a mount point"
    if Path.cwd().is_relative_to(target):
        return "it is the current folder, or has it inside"
    return "" if os.access(target, os.W_OK) else "it is read-only"


def _check_replaceable(place: Path, target: Path, photos: str, *, overwrite: bool) -> None:
    """Raise OutputError if a folder has a file of the user, or the result of another photo.

    Args:
        place: where the folder is.
        target: where it was.
        photos: digests of the photos of the new result.
        overwrite: whether the result of another photo may be replaced.
    """
    start = f"cannot write results to {target}: "
    document = _read_document(place) or {}
    digests = _file_digests(document)
    if document.get("run") == run_of_document(document):
        digests[DOCUMENT_FILE] = file_digest(place / DOCUMENT_FILE)
    for name in _file_names(place):
        digest = "" if (place / name).is_symlink() else file_digest(place / name)
        if not digest or digest != digests.get(name) or digest in photos.split():
            raise OutputError(
                f"{start}{name} there was not written by a run, was edited, or is the photo; name "
                "another folder with -o, or move it away"
            )
    if document and not overwrite and not _is_same_photo(str(document.get("photo", "")), photos):
        raise OutputError(
            f"{start}it holds the result of another photo; name another folder with -o, or replace "
            "that result with --overwrite (overwrite=True in Python)"
        )


def _file_names(folder: Path) -> Iterator[str]:
    """Yield the names of the files in a folder, in order, but those of the system and temporary
    ones; a link and an empty folder are files.
    """

    def fail(error: OSError) -> None:
        raise error

    for at, folders, names in os.walk(folder, onerror=fail):
        folders.sort()
        links = [name for name in folders if os.path.islink(os.path.join(at, name))]
        for name in sorted([*names, *links]):
            if name not in _SYSTEM_FILES and not is_part(name):
                yield Path(at, name).relative_to(folder).as_posix()
        if not folders and not names and Path(at) != folder:
            yield Path(at).relative_to(folder).as_posix()


def write_result_files(
    folder: str | os.PathLike[str],
    document: Mapping[str, Any],
    contents: Mapping[str, bytes],
    photos: str,
    *,
    overwrite: bool = False,
) -> None:
    """Write the files of a result, and replace the folder by them.

    If the folder cannot be replaced, the new files stay in a hidden folder that the error names.

    Args:
        folder: created if missing.
        document: of the result; the names and digests of the other files are added.
        contents: of the other files, by name.
        photos: see :func:`prepare_result_folder`.
        overwrite: likewise.

    Raises:
        OutputError: the folder cannot be written, or a file of the user would be lost.
    """
    target = Path(os.path.realpath(folder))
    new = _hidden(target, f".{secrets.token_hex(4)}.new")
    with _locked(target) as is_locked:
        if is_locked:  # else another process may be writing them
            for left in target.parent.glob(glob.escape(_hidden(target, "").name) + ".*.new"):
                shutil.rmtree(left, ignore_errors=True)
        try:
            _fill(new, document, contents)
        except BaseException:
            shutil.rmtree(new, ignore_errors=True)
            raise
        try:
            _swap_folders(target, new, photos, overwrite=overwrite)
        except (OSError, OutputError) as error:
            why = error if isinstance(error, OutputError) else refusal(target, error)
            raise OutputError(f"{why}; the new result is in {new}") from error


def _fill(new: Path, document: Mapping[str, Any], contents: Mapping[str, bytes]) -> None:
    new.mkdir()
    for name, content in contents.items():
        (new / name).parent.mkdir(parents=True, exist_ok=True)
        (new / name).write_bytes(content)
    (new / DOCUMENT_FILE).write_bytes(_with_files(document, contents))


def _swap_folders(target: Path, new: Path, photos: str, *, overwrite: bool) -> None:
    """Put a new folder in the place of an old one; after an error the old one is there."""
    old = _hidden(target, ".old")
    try:
        if os.path.lexists(target):
            os.rename(target, old)
            _check_replaceable(old, target, photos, overwrite=overwrite)
            shutil.copymode(old, new)
        os.rename(new, target)
    finally:
        _put_back(target)


def _put_back(target: Path) -> None:
    """Give an old folder its name back; delete it if a result has the name."""
    old = _hidden(target, ".old")
    if is_result(target):
        shutil.rmtree(old, ignore_errors=True)
    elif os.path.lexists(old):
        os.rename(old, target)


def _hidden(target: Path, ending: str) -> Path:
    return target.with_name(f".{target.name}.physic{ending}")


@contextmanager
def _locked(target: Path) -> Iterator[bool]:
    """Let no other process write the folder of a result; yield whether there are locks."""
    try:
        with locked(target.parent) as is_locked:
            _put_back(target)
            yield is_locked
    except OSError as error:
        raise refusal(target, error) from error


def add_result_files(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write further files to the folder of a result, and list them in its document, so that the
    next run replaces them; earlier ones of these names are replaced.

    They are listed before they are there: a killed process leaves no file that is not listed.

    Raises:
        OutputError: the folder cannot be written.
    """
    with _locked(Path(os.path.realpath(folder))), atomic_write(folder) as write:
        if (document := _read_document(folder)) is not None:
            write(DOCUMENT_FILE).write_bytes(_with_files(document, contents))
        for name, content in contents.items():
            write(name).write_bytes(content)
        for name in contents:
            (folder / name).unlink(missing_ok=True)


def check_added(folder: Path, name: str) -> None:
    """Raise OutputError if the user edited a file that a result lists."""
    digest = _file_digests(_read_document(folder) or {}).get(name)
    if digest and os.path.lexists(folder / name) and file_digest(folder / name) != digest:
        raise OutputError(f"cannot write {folder / name}: it was edited; name another file with -o")


def _with_files(document: Mapping[str, Any], contents: Mapping[str, bytes]) -> bytes:
    """Return the text of a document that lists further files."""
    files = {**_file_digests(document), **{name: digest_of(contents[name]) for name in contents}}
    text = json.dumps({**document, "files": files}, indent=1, ensure_ascii=False, allow_nan=False)
    # A file name that is not UTF-8 has lone surrogates; backslashreplace writes them as JSON
    # escapes.
    return text.encode("utf-8", "backslashreplace")


def run_of_document(document: Mapping[str, Any]) -> str:
    """Return the ``run`` of a document: a digest of its entries but itself and the list of
    files.
    """
    rest = {name: value for name, value in document.items() if name not in ("run", "files")}
    return hashlib.sha256(json.dumps(rest).encode()).hexdigest()[:16]


def photo_identity_of_result(folder: str | os.PathLike[str]) -> str | None:
    """Read the digests of the photo from the result in a folder; None if there is no result."""
    document = _read_document(Path(folder))
    return None if document is None else str(document.get("photo", ""))


def run_of_result(folder: str | os.PathLike[str]) -> str:
    """Read which run wrote the result in a folder, from both ends of its document; "" if it is
    missing or cut off.
    """
    try:
        with open_regular(UntrustedName(DOCUMENT_FILE).inside(folder)) as file:
            match = _RUN.match(file.read(_END_BYTES))
            file.seek(max(0, file.seek(0, os.SEEK_END) - _END_BYTES))
            return match[1].decode() if match and file.read().rstrip().endswith(b"}") else ""
    except (InputError, OSError):
        return ""


def _is_same_photo(one: str, other: str) -> bool:
    """Return whether two results have a photo in common, by the digests of their photos, separated
    by spaces.
    """
    return one == other or not set(one.split()).isdisjoint(other.split())


def file_digest(source: str | os.PathLike[str] | BufferedReader | BytesIO) -> str:
    """Compute the SHA-256 of a file, given by its path or open at its start; "" if it cannot be
    read.
    """
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


def _read_document(folder: Path) -> dict[str, Any] | None:
    """Read the document of a folder; None if it is missing or invalid."""
    try:
        path = UntrustedName(DOCUMENT_FILE).inside(folder)
        document = parse_json(read_regular(path, MAX_DOCUMENT_BYTES))
    except (InputError, OSError, ValueError):
        return None
    return document if isinstance(document, dict) and document.get("schema") == SCHEMA else None


def _file_digests(document: Mapping[str, Any]) -> dict[str, str]:
    """Return name -> digest of the files that a document lists; it and they are untrusted."""
    files = document.get("files")
    return {name: str(files[name]) for name in files} if isinstance(files, dict) else {}


def people_csv(result: Reconstruction, photo: str) -> bytes:
    """Return the table of one result.

    Args:
        result: with any number of people.
        photo: its name.
    """
    text = io.StringIO(newline="")
    write_csv(text, ["id", *PERSON_COLUMNS], ({"id": photo, **row} for row in person_rows(result)))
    return text.getvalue().encode()


def is_result(folder: str | os.PathLike[str]) -> bool:
    """Return whether a folder has a result, whole or damaged.

    The document tells it, and not its name, which other programs use too.
    """
    try:
        with open_regular(UntrustedName(DOCUMENT_FILE).inside(folder)) as file:
            match = _RUN.match(file.read(_END_BYTES))
    except (InputError, OSError):
        return False
    return match is not None or _read_document(Path(folder)) is not None
