"""Find the results in a folder, and write the contact sheet of results that no batch has made."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from physic_core.batch.contact_sheet import (
    MAX_PHOTOS,
    command_for_missing_pages,
    contact_sheet,
    result_link,
    write_contact_sheet,
)
from physic_core.errors import InputError, OutputError, PhysicError
from physic_core.files.atomic import atomic_write, check_writable
from physic_core.io.result_folder import ARRAYS_FILE, DOCUMENT_FILE
from physic_core.io.results import read_document, read_image

__all__ = ["find_results", "write_index"]

_SHEET = "contact-sheet.html"
_THUMBNAIL = (320, 180)


def find_results(folder: Path) -> list[Path]:
    """Return the folders of all results below a folder, sorted.

    Raises:
        InputError: there is none.
    """
    found = sorted(Path(at) for at, _, names in os.walk(folder) if {DOCUMENT_FILE, ARRAYS_FILE} & set(names))
    if not found and not any(folder.glob("journal*.jsonl")):
        raise InputError(f"no result in {folder}: name the folder of a finished run, or a folder of such folders")
    return found


def write_index(folder: Path, results: Sequence[Path]) -> Path:
    """Write ``contact-sheet.html`` of a folder of results and return its path.

    Args:
        folder: of a batch, whose journal lists the photos, or any folder of results.
        results: their folders, for a folder without a journal.

    Raises:
        OutputError: the file cannot be written, or is not a contact sheet.
    """
    path = folder / _SHEET
    if path.exists() and b"<title>PhySIC contact sheet</title>" not in path.read_bytes()[:1000]:
        raise OutputError(f"cannot write {path}: the file there is not a contact sheet of PhySIC; move it away")
    if any(folder.glob("journal*.jsonl")):
        return write_contact_sheet(folder)
    cards = [_card(folder, result) for result in results[:MAX_PHOTOS]]
    with atomic_write(check_writable(folder)) as temporary:
        command = command_for_missing_pages(folder, [card["title"] for card in cards])
        page = contact_sheet(cards, max(0, len(results) - MAX_PHOTOS), command)
        temporary(_SHEET).write_text(page, encoding="utf-8")
    return path


def _card(folder: Path, result: Path) -> dict[str, Any]:
    name = result.relative_to(folder).as_posix()
    card: dict[str, Any] = {"name": name, "title": name, "link": result_link(folder, name), "thumbnail": ""}
    card |= {"error": "", "message": "", "grade": "", "people": 0, "checks": []}
    try:
        document = read_document(result)
        thumbnail = _thumbnail(result)
    except PhysicError as error:
        return card | {"state": "failed", "error": "InputError", "message": str(error).replace(f"{folder}{os.sep}", "")}
    numbers = {"grade": str(document.get("grade") or ""), "checks": _failed(document)}
    return card | numbers | {"state": "done", "people": len(document["people"]), "thumbnail": thumbnail}


def _failed(document: Mapping[str, Any]) -> list[str]:
    checks = document.get("checks", ())
    return list(dict.fromkeys(str(c["name"]) for c in checks if c.get("state") == "failed" or c.get("ok") is False))


def _thumbnail(result: Path) -> str:
    """Return the photo of a result as a small JPEG in base64; "" for a result of people alone, which has no photo.

    Raises:
        InputError: the arrays are damaged.
    """
    import io

    from PIL import Image

    if not (result / ARRAYS_FILE).exists():
        return ""
    image = Image.fromarray(read_image(result))
    image.thumbnail(_THUMBNAIL)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=72)
    return base64.b64encode(buffer.getvalue()).decode()
