"""The files of a result folder: which of them a run may replace, and how they are replaced
together.

The document names the other files with their SHA-256, so that files that the user edited are
known. It is moved away first and renamed last. Until the end, old and new document stay under
temporary names, so that the next run completes the result of a killed run. Readers write
nothing. ``people.csv``, a row for each person, and ``report.html``, a page for a browser, are
beside them.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import logging
import os
import re
import secrets
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from io import BufferedReader, BytesIO
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from physic_core.errors import InputError, OutputError
from physic_core.files.atomic import (
    AtomicWrite,
    atomic_write,
    check_writable,
    locked,
    open_regular,
    parts_of,
    read_regular,
)
from physic_core.files.names import UntrustedName, paths_inside
from physic_core.files.text import parse_json, write_csv
from physic_core.pictures import GLB_FILE, PREVIEW_FILE, REPORT_FILE
from physic_core.types.results import PERSON_COLUMNS, person_rows

if TYPE_CHECKING:
    from physic_core.types import Reconstruction, UInt8Array

SCHEMA = "physic-reconstruction"
DOCUMENT_FILE = "reconstruction.json"
ARRAYS_FILE = "reconstruction.npz"
PEOPLE_TABLE = "people.csv"
MAX_DOCUMENT_BYTES = 64 << 20
FILES = (DOCUMENT_FILE, ARRAYS_FILE, PREVIEW_FILE, GLB_FILE, REPORT_FILE, PEOPLE_TABLE)
_RUN = re.compile(
    rb'\{\s*"schema": "physic-reconstruction",\s*"schema_version": \d+,\s*"run": "(\w+)"'
)
_END_BYTES = 1000
_LOG = logging.getLogger(__name__)
_PARTS = f".{DOCUMENT_FILE}.*.physic-document"


@dataclass(frozen=True)
class Replaceable:
    """Which results a run may replace in its folder.

    Attributes:
        photos: digests of the photo, or of all photos of a moment, separated by spaces.
        overwrite: whether those of other photos too.
        earlier: names of files that an earlier run wrote, even if no document lists them.
    """

    photos: str
    overwrite: bool = False
    earlier: Collection[str] = ()


def check_overwrite(folder: Path, replaceable: Replaceable, names: Iterable[str]) -> None:
    """Check that writing a result to a folder would replace no file of the user.

    Args:
        folder: where the result will be written.
        replaceable: which results may be replaced.
        names: of the files that will be written.

    Raises:
        OutputError: a file with one of these names is the photo, or was not written by a run; the
            folder has the result of another photo.
    """
    present = [name for name in names if os.path.lexists(folder / name)]
    unchanged, edited = _earlier_files(folder, replaceable)
    photos = [name for name in present if file_digest(folder / name) in replaceable.photos.split()]
    foreign = [name for name in present if name not in {*photos, *unchanged, *edited}]
    whose = photo_identity_of_result(folder)
    cure = f"move {', '.join([*photos, *foreign])} away"
    faults = [f"{', '.join(photos)} there is the photo itself"] if photos else []
    if foreign:
        faults.append(
            f"{', '.join(foreign)} there {'is' if len(foreign) == 1 else 'are'} not of an earlier "
            f"run"
        )
    if (
        not faults
        and whose is not None
        and not is_same_photo(whose, replaceable.photos)
        and not replaceable.overwrite
    ):
        faults = ["it holds the result of another photo"]
        cure = "replace that result with --overwrite (overwrite=True in Python)"
    if faults:
        raise OutputError(
            f"cannot write results to {folder}: {'; '.join(faults)}: name another folder, or {cure}"
        )


def write_result_files(
    folder: Path,
    document: Mapping[str, Any],
    contents: Mapping[str, bytes],
    replaceable: Replaceable,
) -> None:
    """Write the files of a result, all or none, in place of those of an earlier one; edited files
    of it are kept.

    Args:
        folder: created if missing.
        document: of the result; the names and digests of the other files are added.
        contents: of the other files, by name.
        replaceable: which results may be replaced.

    Raises:
        OutputError: the folder cannot be written, or user data would be lost.
    """
    with atomic_write(check_writable(folder)) as write:
        check_overwrite(folder, replaceable, [DOCUMENT_FILE, *contents])
        unchanged, edited = _earlier_files(folder, replaceable)
        former = list(folder.glob(_PARTS))
        _write_parts(folder, write, document, contents)
        write.seal()
        swap = partial(
            _swap, folder, write, list(edited), unchanged - {DOCUMENT_FILE, *contents}, former
        )
        try:
            if DOCUMENT_FILE in unchanged:
                former.append(_part(folder))
                os.replace(folder / DOCUMENT_FILE, former[-1])
            swap()
        except BaseException:
            # Without a document nothing is readable, so the new result is made whole before the
            # error is raised.
            if not (folder / DOCUMENT_FILE).exists():
                write.is_only_copy = True
                swap()
            raise


def add_result_file(folder: Path, name: str, content: bytes) -> None:
    """Write a file to the folder of a result, and list it in the document; an edited file of that
    name is kept.

    The result stays complete at each step.

    Raises:
        OutputError: the folder cannot be written.
    """
    with atomic_write(check_writable(folder)) as write:
        write.expect(ARRAYS_FILE)
        document = _document(folder)
        if document is None:
            write(name).write_bytes(content)
            return
        _write_parts(folder, write, document, {name: content})
        if name in _earlier_files(folder, Replaceable(""))[1]:
            _keep(folder / name)


def record_exports(folder: Path, files: Iterable[Path]) -> None:
    """Record exported files inside a result folder in its document, so that the next run removes
    them.

    Raises:
        OutputError: the folder cannot be written.
    """
    names = [file.relative_to(folder).as_posix() for file in files if file.is_relative_to(folder)]
    digests = {name: file_digest(folder / name) for name in names}
    with atomic_write(check_writable(folder)) as write:
        write.expect(ARRAYS_FILE)
        document = _document(folder)
        if names and document is not None:
            listed = _files(folder, document) | digests
            _write_parts(folder, write, {**document, "files": listed}, {})


def check_finished(folder: Path) -> None:
    """Raise InputError if a process was killed while it put the files of a result in place."""
    if is_unfinished(folder):
        raise InputError(
            f"cannot read {folder / DOCUMENT_FILE}: the result is unfinished, since a process was "
            f"killed while it wrote it; run the same command (physic run, scene or batch) with "
            f"this folder again, which completes it"
        )


def repair_result(folder: Path) -> None:
    """Put the new files of a result in place if a process was killed while it did; a log message
    says so.

    Only writers of results call it. Where folders have no locks, nothing is done: another process
    may be writing there.
    """
    if not is_unfinished(folder):
        return
    try:
        with locked(folder) as is_locked:
            if is_locked and is_unfinished(folder) and _complete_result(folder):
                _LOG.warning(
                    "%s: a process was killed while it wrote the result there, which was completed",
                    folder,
                )
    except OSError as error:
        _LOG.warning(
            "%s: a process was killed while it wrote the result there, which cannot be completed: "
            "%s; allow writing",
            folder,
            error.strerror,
        )


def is_unfinished(folder: Path) -> bool:
    """Return whether a folder has no document but those that a killed process has moved away or not
    yet renamed.
    """
    return not os.path.lexists(folder / DOCUMENT_FILE) and any(folder.glob(_PARTS))


def _complete_result(folder: Path) -> bool:
    """Make the result of the latest document whole, from its temporary files; return whether there
    is one.
    """
    found = [
        (path, document)
        for path in folder.glob(_PARTS)
        if (document := _document(folder, path.name)) is not None
    ]
    for path, document in sorted(found, key=lambda each: each[0].stat().st_mtime_ns, reverse=True):
        digests = _files(folder, document)
        ready = {
            name: part
            for name in digests
            for part in parts_of(folder, name)
            if file_digest(part) == digests[name]
        }
        if ARRAYS_FILE in ready or file_digest(folder / ARRAYS_FILE) == digests.get(ARRAYS_FILE):
            unchanged, edited = _earlier_files(folder, Replaceable(""))
            _swap(
                folder,
                AtomicWrite(folder, {**ready, DOCUMENT_FILE: path}),
                list(edited),
                unchanged - {DOCUMENT_FILE, *digests},
                list(folder.glob(_PARTS)),
            )
            return True
    return False


def _write_parts(
    folder: Path, write: AtomicWrite, document: Mapping[str, Any], contents: Mapping[str, bytes]
) -> None:
    """Write files under temporary names, and last the document that lists them."""
    listed = _files(folder, document)
    files = {**listed, **{name: digest_of(content) for name, content in contents.items()}}
    text = json.dumps({**document, "files": files}, indent=1, ensure_ascii=False, allow_nan=False)
    for name, content in contents.items():
        write(name).write_bytes(content)
    # A file name that is not UTF-8 has lone surrogates; backslashreplace writes them as JSON
    # escapes.
    write(DOCUMENT_FILE, _part(folder)).write_bytes(text.encode("utf-8", "backslashreplace"))


def _swap(
    folder: Path,
    write: AtomicWrite,
    to_keep: list[str],
    gone: Iterable[str],
    former: Iterable[Path],
) -> None:
    """Put the files of a new result in the place of an earlier one; after an interruption, another
    call goes on.

    Args:
        folder: of the result.
        write: of the new files, the document last.
        to_keep: files that the user edited; those that are done are removed from the list.
        gone: files of the earlier result that the new one does not have.
        former: temporary paths of earlier documents.
    """
    while to_keep:
        if os.path.lexists(folder / to_keep[-1]):
            _keep(folder / to_keep[-1])
        to_keep.pop()
    for name in gone:
        if os.path.lexists(folder / name):
            (folder / name).unlink()
        with suppress(OSError):  # other files are in the folder
            for inner in PurePosixPath(name).parents[:-1]:
                (folder / inner).rmdir()
    write.rename()
    for part in former:
        part.unlink(missing_ok=True)


def _part(folder: Path) -> Path:
    return folder / _PARTS.replace("*", secrets.token_hex(4))


def _keep(path: Path) -> None:
    """Rename a file that the user edited: ``preview.png`` to ``preview.edited.png``."""
    endings = itertools.chain([""], (f"-{number}" for number in itertools.count(2)))
    names = (path.with_name(f"{path.stem}.edited{ending}{path.suffix}") for ending in endings)
    path.rename(next(name for name in names if not os.path.lexists(name)))


def _earlier_files(folder: Path, replaceable: Replaceable) -> tuple[set[str], set[str]]:
    """Return the names of the files in a folder that an earlier run wrote: unchanged ones, and
    edited ones.

    The run may have been killed while writing them. A file with another digest, a link or a folder
    under such a name is edited: it belongs to the user. The document belongs to the run, even if it
    was edited.
    """
    digests = [_files(folder, document) for document in _documents(folder)]
    earlier = paths_inside(folder, replaceable.earlier)
    there = {
        name for name in (*earlier, *itertools.chain(*digests)) if os.path.lexists(folder / name)
    }

    def is_unchanged(name: str) -> bool:
        is_link = os.path.realpath(folder / name) != os.path.join(os.path.realpath(folder), name)
        return not is_link and file_digest(folder / name) in {one.get(name) for one in digests}

    unchanged = set(filter(is_unchanged, there))
    edited = there - unchanged - {DOCUMENT_FILE}
    is_own = DOCUMENT_FILE in there or _document(folder) is not None
    if (
        is_own
        and os.path.isfile(folder / DOCUMENT_FILE)
        and not os.path.islink(folder / DOCUMENT_FILE)
    ):
        unchanged.add(DOCUMENT_FILE)
    return unchanged, edited


def photo_identity_of_result(folder: str | os.PathLike[str]) -> str | None:
    """Read the digests of the photo from the result in a folder, finished or not; None if there is
    no result.
    """
    return next((str(one.get("photo", "")) for one in _documents(Path(folder))), None)


def run_of_result(folder: str | os.PathLike[str]) -> str:
    """Read which run wrote the result in a folder, from both ends of its document; "" if it is
    missing or cut off.
    """
    try:
        with open_regular(UntrustedName(DOCUMENT_FILE).inside(folder)) as file:
            found = _RUN.match(file.read(_END_BYTES))
            file.seek(max(0, file.seek(0, os.SEEK_END) - _END_BYTES))
            return found[1].decode() if found and file.read().rstrip().endswith(b"}") else ""
    except (InputError, OSError):
        return ""


def is_same_photo(one: str, other: str) -> bool:
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


def _documents(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the document of a folder, and those that a killed process has left."""
    for name in (DOCUMENT_FILE, *(path.name for path in folder.glob(_PARTS))):
        if (found := _document(folder, name)) is not None:
            yield found


def _document(folder: Path, name: str = DOCUMENT_FILE) -> dict[str, Any] | None:
    """Read a document; None if it is missing or invalid."""
    try:
        path = UntrustedName(name).inside(folder)
        document = parse_json(read_regular(path, MAX_DOCUMENT_BYTES))
    except (InputError, OSError, ValueError):
        return None
    return document if isinstance(document, dict) and document.get("schema") == SCHEMA else None


def _files(folder: Path, document: Mapping[str, Any]) -> dict[str, str]:
    """Return name -> digest of the files in a folder that a document lists, some in folders of it;
    the document is untrusted.
    """
    files = document.get("files")
    digests = files if isinstance(files, dict) else {}
    inside = paths_inside(folder, digests)
    return {name: str(digests[name]) for name in inside if name != DOCUMENT_FILE}


def people_csv(result: Reconstruction, photo: str) -> bytes:
    """Return the table of one result.

    Args:
        result: with any number of people.
        photo: its name.
    """
    text = io.StringIO(newline="")
    write_csv(text, list(PERSON_COLUMNS), ({"id": photo, **row} for row in person_rows(result)))
    return text.getvalue().encode()


def is_result(folder: str | os.PathLike[str]) -> bool:
    """Return whether a folder has a result, whole or damaged, or one that a killed process has not
    completed.

    The document tells it, and not its name, which other programs use too.
    """
    folder = Path(folder)
    parts = (path.name for path in folder.glob(_PARTS)) if is_unfinished(folder) else ()
    return any(_states_schema(folder, name) for name in (DOCUMENT_FILE, *parts))


def _states_schema(folder: Path, name: str) -> bool:
    try:
        with open_regular(UntrustedName(name).inside(folder)) as file:
            found = _RUN.match(file.read(_END_BYTES))
    except (InputError, OSError):
        return False
    return found is not None or _document(folder, name) is not None


def files_of_result(folder: str | os.PathLike[str]) -> frozenset[str]:
    """Return the names of the files that the document of a folder lists, some in folders of it."""
    return frozenset(_files(Path(folder), _document(Path(folder)) or {}))
