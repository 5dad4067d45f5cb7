"""The files of a photo's result: their sizes for the journal, and whether they are still there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physic_core.batch.thumbnails import thumbnail_path
from physic_core.io.result_folder import ARRAYS_FILE, DOCUMENT_FILE, digests_of_result

_THUMBNAIL = "thumbnail"


def result_digest(folder: Path) -> str:
    """Return the digest of the arrays that ``reconstruction.json`` of a folder states; "" without a result."""
    return digests_of_result(folder).get(ARRAYS_FILE, "")


def file_sizes_text(out: Path, folder: str, *, thumbnails: bool) -> str:
    """Return "NAME=BYTES NAME=BYTES ..." of the files of a photo's folder, and of its thumbnail as the last one.

    Raises:
        OSError: one of them is missing.
    """
    digests = digests_of_result(out / folder)
    paths = {name: out / folder / name for name in ([DOCUMENT_FILE, *digests] if digests else [])}
    if thumbnails:
        paths[_THUMBNAIL] = out / thumbnail_path(folder)
    return " ".join(f"{name}={path.stat().st_size}" for name, path in paths.items())


def is_complete(folder: Path, row: Mapping[str, Any]) -> bool:
    """Return whether a folder has the result that the row of a photo states, with all its files.

    Pictures and the document may be edited; arrays have their size. The thumbnail does not count.
    """
    if result_digest(folder) != row.get("result"):  # after a kill before the row: those of a later run
        return False
    sizes = sizes_of_files(row)
    try:
        found = {name: (folder / name).lstat().st_size for name in sizes}
    except OSError:
        return False
    return found.get(ARRAYS_FILE) == sizes.get(ARRAYS_FILE)


def sizes_of_files(row: Mapping[str, Any]) -> dict[str, int]:
    """Return name -> bytes of the files in a photo's folder that its row of the journal states."""
    pairs = (text.rpartition("=") for text in str(row.get("files", "")).split())
    return {name: int(size) for name, _, size in pairs if name != _THUMBNAIL}
