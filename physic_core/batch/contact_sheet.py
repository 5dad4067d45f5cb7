"""Write ``contact-sheet.html``: thumbnails and numbers of many photos on one page, with filters, without a network."""

from __future__ import annotations

import base64
import html
import json
import os
import shlex
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any

from physic_core.batch.journal import last_rows
from physic_core.batch.photos import photo_folder
from physic_core.batch.saving import thumbnail_path
from physic_core.files.atomic import atomic_write
from physic_core.io.result_folder import ARRAYS_FILE, PREVIEW_FILE, REPORT_FILE

__all__ = ["MAX_PHOTOS", "command_for_missing_pages", "contact_sheet", "result_link", "write_contact_sheet"]

MAX_PHOTOS = 5000
"""Most photos of one page, which then has about 60 MB."""


def write_contact_sheet(out: Path, limit: int = MAX_PHOTOS) -> Path:
    """Write the contact sheet of a batch to its output folder and return its path.

    Raises:
        OutputError: a file cannot be written.
    """
    rows = last_rows(out)
    shown = list(islice(rows, limit))
    left_out = sum(1 for _ in rows)
    above = _common_folder([str(row.get("path", "")) for row in shown])
    page = contact_sheet(
        [_card(out, row, above) for row in shown],
        left_out,
        command_for_missing_pages(out, [str(row.get("folder", "")) for row in shown]),
    )
    with atomic_write(out) as temporary:
        temporary("contact-sheet.html").write_text(page, encoding="utf-8")
    return out / "contact-sheet.html"


def contact_sheet(cards: Sequence[Mapping[str, Any]], left_out: int = 0, command: str = "") -> str:
    """Return the page.

    Args:
        cards: of photos: name (its id), title, link, thumbnail (base64 JPEG), state, error, message, grade, people,
            checks.
        left_out: number of photos that are not on the page; the page states it.
        command: that writes the pages of results that have none; "" if there are none.
    """
    from physic_core.pipeline.checks import CHECKS

    notes = [f"{left_out:,} more photos are in the summary table only."] if left_out else []
    if command:
        notes.append(f"Some results have no page in 3D yet. To write them: {command}")
    labels = {spec.name: spec.label for spec in CHECKS.values()}
    page = (files("physic_core.batch") / "contact_sheet.html").read_text(encoding="utf-8")
    page = page.replace("@NOTE@", "\n  ".join(f'<p class="soft">{html.escape(note)}</p>' for note in notes))
    return page.replace("@LABELS@", _script_json(labels)).replace("@DATA@", _script_json(list(cards)))


def result_link(out: Path, folder: str) -> str:
    """Return the link to the page of a result, else to its preview or its folder, relative to the output folder.

    It is "" without files.
    """
    if not folder:
        return ""
    names = (name for name in (REPORT_FILE, PREVIEW_FILE) if (out / folder / name).is_file())
    return f"{folder}/{next(names, '')}"


def command_for_missing_pages(out: Path, folders: Iterable[str]) -> str:
    """Return the command that writes the pages of results; "" if each that can be loaded has one.

    Args:
        out: folder of all results.
        folders: of the results, relative to ``out``.
    """
    missing = any((out / f / ARRAYS_FILE).is_file() and not (out / f / REPORT_FILE).is_file() for f in folders if f)
    return f"physic report {shlex.quote(out.name)} --each" if missing else ""


def _script_json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=True).replace("<", "\\u003c")  # "<" could end the script element


def _common_folder(paths: Sequence[str]) -> str:
    """Return the folder of all photos with its separator, which a page that is sent to others need not tell them."""
    try:
        return os.path.join(os.path.commonpath([os.path.dirname(path) for path in paths]), "")
    except ValueError:  # no photos, or addresses among the paths
        return ""


def _card(out: Path, row: Mapping[str, Any], above: str) -> dict[str, Any]:
    path, done = str(row.get("path", "")), row["state"] == "done"
    thumbnail = out / thumbnail_path(photo_folder(str(row["id"])))
    title = path.removeprefix(above) if above else os.path.basename(path)
    message = str(row.get("message", "")).replace(path, title)
    for folder in filter(None, (above, f"{out}{os.sep}")):
        message = message.replace(folder, "")
    return {
        "name": row["id"],
        "title": title or row["id"],
        "link": result_link(out, str(row.get("folder", ""))),
        "thumbnail": base64.b64encode(thumbnail.read_bytes()).decode() if done and thumbnail.is_file() else "",
        "state": row["state"],
        "error": row.get("error", ""),
        "message": message.removeprefix(f"{title}: "),
        "grade": row.get("grade", ""),
        "people": int(row.get("people") or 0) if done else None,
        "checks": str(row.get("checks_failed", "")).split(),
    }
