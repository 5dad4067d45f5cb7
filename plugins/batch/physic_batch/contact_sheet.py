"""``contact-sheet.html``: thumbnails and numbers of many photos on one page, with filters, without
a network.
"""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_batch.journal import JournalIndex, journal_files
from physic_batch.photos import photo_folder
from physic_core.errors import InputError, PhysicError
from physic_core.files import (
    MARK,
    ImageSource,
    atomic_write,
    check_own,
    check_writable,
    decode,
    open_image,
    path_to_write,
    paths_inside,
    read_regular,
    write_own,
)
from physic_core.io.result_folder import ARRAYS_FILE, is_result
from physic_core.io.results import read_image, read_record
from physic_core.pictures import PREVIEW_FILE, REPORT_FILE
from physic_core.types import MARKS, is_usable

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

    from physic_core.types import Reconstruction

_PACKAGE = files("physic_batch")

_MAX_THUMBNAIL_BYTES = 1 << 20
_MAX_PHOTOS = 5000
"""Most photos of one page, which then has about 60 MB."""

_SHOWN = (
    *("id", "path", "state", "error", "message", "people", "checks_failed"),
    *("save", "folder", *(f"usable_{mark}" for mark in MARKS)),
)
"""Columns of a photo's row that its card needs."""

_FILE = "contact-sheet.html"
_MARK = "<title>PhySIC contact sheet</title>"
_THUMBNAIL = (320, 180)
_HEIGHT = 180  # px of a thumbnail: photo with people, and side view
_NARROWEST = 1 / 3
_WIDEST = 16 / 9
_SIDE_VIEW = 11 / 9
"""Width over height of the narrowest and the widest photo, and of the side view."""


def check_contact_sheet(out: Path) -> None:
    """Raise OutputError if the contact sheet of a folder would replace a file that PhySIC has not
    written.
    """
    check_own(out / _FILE, mark=_MARK)


def write_contact_sheet(
    out: Path, results: Sequence[Path] = (), index: JournalIndex | None = None
) -> Path:
    """Write the contact sheet of a folder of results and return its path.

    Args:
        out: folder of a batch, whose journal lists the photos, or any folder of results.
        results: their folders, for a folder without a journal.
        index: of the journals; None to make it if there are any.

    Raises:
        OutputError: the file cannot be written, or is not a contact sheet.
    """
    check_contact_sheet(out)
    if index is None and (journals := journal_files(out)):
        index = JournalIndex(journals)
    if index is not None:
        ids = index.ids()
        rows = [
            {name: row[name] for name in _SHOWN if name in row}
            for row in filter(None, index.rows(ids[:_MAX_PHOTOS], with_people=False))
        ]
        hidden = len(ids[_MAX_PHOTOS:])
        common_folder = _common_folder([str(row.get("path", "")) for row in rows])
        cards = [_photo_card(out, row, common_folder) for row in rows]
    else:
        cards = [_result_card(check_writable(out), result) for result in results[:_MAX_PHOTOS]]
        hidden = max(0, len(results) - _MAX_PHOTOS)
    with (
        atomic_write(out) as temporary,
        temporary(_FILE).open("w", encoding="utf-8") as file,
    ):
        file.writelines(contact_sheet(cards, hidden))
    return out / _FILE


def contact_sheet(cards: Sequence[Mapping[str, Any]], hidden: int = 0) -> Iterator[str]:
    """Yield the parts of the page.

    Args:
        cards: of photos: name (its id), title, link, lacks_page (whether its page can still be
            written), thumbnail (base64 JPEG, or its file), state, error, message,
            usable (mark -> number of people), people, checks.
        hidden: number of photos that are not on the page; the page states it.
    """
    from physic_core.judge import CHECKS

    notes = [f"{hidden:,} more photos are in the summary table only."] if hidden else []
    if any(card.get("lacks_page") for card in cards):
        notes.append(
            '"physic report . --each" in the folder of this file writes a 3D page of each photo '
            "and links it."
        )
    labels = {spec.name: spec.label for spec in CHECKS.values()}
    page = fill_page(_PACKAGE / "contact_sheet.html", NOTES=notes, LABELS=labels)
    before, _, after = page.partition("@DATA@")
    yield f"{before}["
    for number, card in enumerate(cards):
        if isinstance(card["thumbnail"], Path):
            card = {**card, "thumbnail": _jpeg_base64(card["thumbnail"])}
        yield f"{', ' if number else ''}{_in_script(card)}"
    yield f"]{after}"


def _jpeg_base64(path: Path) -> str:
    """Return the content of a JPEG; "" if it is anything else, of which a page shows nothing."""
    with suppress(OSError, InputError):
        source = ImageSource(path.name, read_regular(path, _MAX_THUMBNAIL_BYTES))
        with open_image(source) as (image, _):
            if image.format == "JPEG" and image.height <= _HEIGHT:
                decode(image, source)
                return base64.b64encode(source.content or b"").decode()
    return ""


def fill_page(page: Traversable, **data: Any) -> str:
    """Return a page with the common style, the mark of PhySIC, and data in place of @NAME@.

    Texts of the user are in the last ones: a later name in them would be replaced.
    """
    text = page.read_text(encoding="utf-8").replace("@MARK@", MARK)
    text = text.replace("@STYLE@", (_PACKAGE / "page.css").read_text(encoding="utf-8"))
    for key, value in data.items():
        text = text.replace(f"@{key}@", _in_script(value))
    return text


def _in_script(value: Any) -> str:
    """Return JSON without "<", which could end the script element."""
    return json.dumps(value, ensure_ascii=True).replace("<", "\\u003c")


def find_results(folder: Path) -> list[Path]:
    """Return the folders of all results below a folder, sorted.

    Raises:
        InputError: there is none.
    """
    folders_of_results = list[Path]()
    for at, folders, names in os.walk(folder):
        folders[:] = (name for name in folders if not name.startswith("."))
        if ARRAYS_FILE in names or is_result(at):
            folders_of_results.append(Path(at))
    if not folders_of_results and not journal_files(folder):
        raise InputError(
            f"no result in {folder}: name the folder of a finished run, or a folder of such folders"
        )
    return sorted(folders_of_results)


def result_link(place: Path, result: Path) -> str:
    """Return the link from a folder to the page of a result, else to its preview; "" without
    both.
    """
    pages = filter(os.path.isfile, paths_inside(result, (REPORT_FILE, PREVIEW_FILE)).values())
    return next((Path(os.path.relpath(page, place)).as_posix() for page in pages), "")


def _common_folder(paths: Sequence[str]) -> str:
    """Return the common folder of all photos with its separator, which the page omits from their
    paths.
    """
    try:
        return os.path.join(os.path.commonpath([os.path.dirname(path) for path in paths]), "")
    except ValueError:  # no photos, or addresses among the paths
        return ""


def _photo_card(out: Path, row: Mapping[str, Any], common_folder: str) -> dict[str, Any]:
    path = str(row.get("path", ""))
    done = row["state"] == "done"
    thumbnail = thumbnail_path(photo_folder(row["id"]))
    title = path.removeprefix(common_folder) if common_folder else os.path.basename(path)
    message = str(row.get("message", "")).replace(path, title)
    for folder in filter(None, (common_folder, f"{out}{os.sep}")):
        message = message.replace(folder, "")
    folder = str(row.get("folder", ""))
    paths = paths_inside(out, (folder, thumbnail))
    link = result_link(out, paths[folder]) if folder in paths else ""
    return {
        "name": row["id"],
        "title": title or row["id"],
        "link": link,
        "lacks_page": done
        and row.get("save") in ("pictures", "numbers")
        and not link.endswith(REPORT_FILE),
        "thumbnail": paths.get(thumbnail, "") if done else "",
        "state": row["state"],
        "error": row.get("error", ""),
        "message": message.removeprefix(f"{title}: "),
        "usable": {mark: int(row.get(f"usable_{mark}") or 0) for mark in MARKS},
        "people": int(row.get("people") or 0) if done else None,
        "checks": str(row.get("checks_failed", "")).split(),
    }


def _result_card(folder: Path, result: Path) -> dict[str, Any]:
    name = result.relative_to(folder).as_posix()
    card: dict[str, Any] = {
        "name": name,
        "title": name,
        "link": result_link(folder, result),
        "thumbnail": "",
    }
    card |= {"error": "", "message": "", "usable": {}, "people": 0, "checks": []}
    try:
        record = read_record(result)
        thumbnail = _photo_base64(result)
    except PhysicError as error:
        return card | {
            "state": "failed",
            "error": "InputError",
            "message": str(error).replace(f"{folder}{os.sep}", ""),
        }
    failed = list(dict.fromkeys(check.name for check in record.checks if check.failed))
    card |= {
        "usable": {
            mark: sum(is_usable(row[f"trust_{mark}"]) for row in record.rows) for mark in MARKS
        },
        "checks": failed,
        "people": len(record.rows),
        "thumbnail": thumbnail,
    }
    lacks_page = thumbnail != "" and not card["link"].endswith(REPORT_FILE)
    return card | {"state": "done", "lacks_page": lacks_page}


def _photo_base64(result: Path) -> str:
    """Return the photo of a result as a small JPEG in base64; "" for a result with only people,
    which has no photo.

    Raises:
        InputError: the arrays are damaged.
    """
    from PIL import Image

    picture = read_image(result)
    if picture is None:
        return ""
    image = Image.fromarray(picture)
    image.thumbnail(_THUMBNAIL)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=72)
    return base64.b64encode(buffer.getvalue()).decode()


def thumbnail_path(folder: str) -> str:
    """Return the path of a thumbnail in the output folder for a photo's folder "photos/3f/NAME"."""
    return f"thumbnails/{folder.removeprefix('photos/')}.jpg"


def write_thumbnail(result: Reconstruction, out: Path, folder: str) -> Path:
    """Write the thumbnail of a photo as one small JPEG of 180 px height, and return its path.

    Args:
        result: of the photo.
        out: folder of the batch.
        folder: of the photo, relative to ``out``.

    Raises:
        OutputError: it cannot be written.
    """
    return write_own(path_to_write(out, thumbnail_path(folder)), thumbnail_jpeg(result, _HEIGHT))


def thumbnail_jpeg(result: Reconstruction, height: int, *, numbered: bool = False) -> bytes:
    """Return the people over the photo, and the side view, as one JPEG of a height in px.

    Args:
        result: with its people.
        height: of the picture, px.
        numbered: draw the number of each person.
    """
    import numpy as np
    from PIL import Image, ImageDraw

    from physic_visual.panels import overlay_panel
    from physic_visual.person_numbers import draw_numbers, heads_in_photo
    from physic_visual.views import build_preview_geometry, side_view

    geometry = build_preview_geometry(result)
    aspect = result.image.shape[1] / result.image.shape[0]
    wide = round(height * max(_NARROWEST, min(_WIDEST, aspect)))
    side = side_view(geometry, round(_SIDE_VIEW * height), height)
    over = overlay_panel(result, geometry, wide, height)
    picture = Image.fromarray(np.concatenate([over, side.picture], axis=1))
    if numbered:
        pen = ImageDraw.Draw(picture)
        draw_numbers(pen, (0, 0), heads_in_photo(result, wide, height), (wide, height))
        draw_numbers(pen, (wide, 0), side.crowns, (picture.width - wide, height))
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=72, optimize=True, comment=MARK)
    return buffer.getvalue()
