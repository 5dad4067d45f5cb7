"""The files of a photo's result: their sizes for the journal, and whether they are still there."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from physic_core.batch.thumbnails import thumbnail_path
from physic_core.errors import InputError
from physic_core.io.document import read_document
from physic_core.io.result_folder import (
    ARRAYS_FILE,
    DOCUMENT_FILE,
    PEOPLE_FILE,
    PREVIEW_FILE,
    REPORT_FILE,
    digests_of_result,
    file_digest,
)
from physic_core.io.saved_files import Saving

_THUMBNAIL = "thumbnail"


def result_digest(folder: Path, saving: Saving) -> str:
    """Return the digest of the arrays of a photo's result, or of its picture if it has none; "" without a result.

    The digest of arrays is the one that ``reconstruction.json`` states. A report that is added later does not change
    it.
    """
    if saving.level == "summary":
        return file_digest(folder / saving.main_file) if saving.main_file else ""
    arrays = PEOPLE_FILE if saving.level == "people" else ARRAYS_FILE
    return digests_of_result(folder).get(arrays, "")


def file_sizes_text(out: Path, folder: str, saving: Saving, *, thumbnails: bool) -> str:
    """Return "NAME=BYTES NAME=BYTES ..." of the files of a photo's folder, and of its thumbnail as the last one.

    Raises:
        OSError: one of them is missing.
    """
    if saving.level == "summary":
        pages = {PREVIEW_FILE: saving.preview, REPORT_FILE: saving.report}
        names = [name for name, wanted in pages.items() if wanted]
    else:
        names = _names(out / folder)
    paths = {name: out / folder / name for name in names}
    if thumbnails:
        paths[_THUMBNAIL] = out / thumbnail_path(folder)
    return " ".join(f"{name}={path.stat().st_size}" for name, path in paths.items())


def is_complete(out: Path, folder: str, row: Mapping[str, Any], saving: Saving) -> bool:
    """Return whether the files that the row of a finished photo names are there, and its numbers have their sizes.

    Numbers of another size count if their digest is that of ``reconstruction.json``: a report that is added later
    changes some. Pictures may be edited, and the thumbnail does not count.

    Args:
        out: folder of the batch.
        folder: of the photo, relative to ``out``.
        row: of the journal.
        saving: what was saved.
    """
    sizes = {name: int(size) for name, _, size in (text.partition("=") for text in str(row.get("files", "")).split())}
    sizes.pop(_THUMBNAIL, None)
    found = {name: _size(out / folder / name) for name in sizes}
    if -1 in found.values():
        return False
    different = [name for name in (DOCUMENT_FILE, ARRAYS_FILE, PEOPLE_FILE) if found.get(name) != sizes.get(name)]
    return not different or _have_their_digests(out / folder, different)


def names_of_files(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the files in a photo's folder that its row of the journal states."""
    names = (text.partition("=")[0] for text in str(row.get("files", "")).split())
    return tuple(name for name in names if name != _THUMBNAIL and os.path.basename(name) == name)


def _names(folder: Path) -> list[str]:
    return [DOCUMENT_FILE, *digests_of_result(folder)]


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1


def _have_their_digests(folder: Path, names: Iterable[str]) -> bool:
    """Whether files of a result are those that its ``reconstruction.json`` names, and that one is valid."""
    try:
        digests = read_document(folder)["digests"]
    except InputError:
        return False
    return all(file_digest(folder / name) == digests.get(name) for name in names if name != DOCUMENT_FILE)
