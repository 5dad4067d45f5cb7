"""A comparison for readers: rows of a table, and a page with the pictures of both results side by side."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from statistics import median
from typing import TYPE_CHECKING

from physic_core.batch.thumbnails import thumbnail_jpeg
from physic_core.files.atomic import MARK

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.batch.comparison import Comparison, PersonPair
    from physic_core.types import Reconstruction

HEAD = ("photo", "person", "grade", "distance", "joints", "pose", "contact that one has alone")

_PICTURE_HEIGHT = 320

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>PhySIC comparison</title>
<!-- {mark} -->
<style>
  :root {{ color-scheme: light dark; }}
  body {{ font: 14px/1.4 system-ui, sans-serif; margin: 16px; }}
  table {{ border-collapse: collapse; display: block; overflow-x: auto; }}
  th, td {{ border: 1px solid #8886; padding: 3px 8px; text-align: left; vertical-align: top; }}
  .pair {{ display: flex; flex-wrap: wrap; gap: 8px; }}
  figure {{ flex: 1 1 420px; margin: 0; }}
  img {{ width: 100%; }}
</style>
<h1>Comparison</h1>
{body}
</html>
"""


def table_rows(photo: Comparison) -> list[tuple[str, ...]]:
    """Return the rows of a photo, with the columns of :data:`HEAD`: one of the scene, then one of each person."""
    scene = "-" if photo.depth_ratio is None else f"depth x {photo.depth_ratio:.2f}"
    return [
        (photo.photo, "scene", _both(*photo.grade), scene, "", "", ""),
        *((photo.photo, *_person_cells(person)) for person in photo.people),
    ]


def summary_lines(photos: Sequence[Comparison], only: tuple[Sequence[Path], Sequence[Path]]) -> list[str]:
    """Return sentences about all photos, and about those of which one folder alone has a result."""
    people = [person for photo in photos for person in photo.people]
    pairs = [person for person in people if None not in person.index]
    joints = [person.joints_m for person in pairs if person.joints_m is not None]
    poses = [person.pose_m for person in pairs if person.pose_m is not None]
    ratios = [ratio for photo in photos if (ratio := photo.depth_ratio) is not None]
    lines = [
        f"{len(pairs)} people in both; {sum(person.index[1] is None for person in people)} only in A; "
        f"{sum(person.index[0] is None for person in people)} only in B"
    ]
    if joints:
        lines.append(f"medians of people: joints {1000 * median(joints):.0f} mm, pose {1000 * median(poses):.0f} mm")
    if ratios:
        lines.append(f"median of scenes: the depth of B is {median(ratios):.2f} times that of A")
    for name, folders in zip("AB", only, strict=True):
        lines += [f"only in {name}: {folder.name}" for folder in folders]
    return lines


def picture_pair(a: Reconstruction, b: Reconstruction) -> tuple[bytes, bytes]:
    """Return the people over the photo, and the side view, of each result as a JPEG."""
    return thumbnail_jpeg(a, _PICTURE_HEIGHT), thumbnail_jpeg(b, _PICTURE_HEIGHT)


def comparison_page(
    photos: Sequence[Comparison], pictures: Sequence[tuple[bytes, bytes]], names: tuple[str, str], lines: Sequence[str]
) -> str:
    """Return the page.

    Args:
        photos: all comparisons.
        pictures: JPEG files of A and B of each.
        names: of A and B.
        lines: of :func:`summary_lines`.
    """
    body = [f"<p>{html.escape(line)}</p>" for line in (f"A: {names[0]}", f"B: {names[1]}", *lines)]
    for photo, pair in zip(photos, pictures, strict=True):
        body.append(f'<h2>{html.escape(photo.photo)}</h2>\n<div class="pair">')
        for name, picture in zip("AB", pair, strict=True):
            data = base64.b64encode(picture).decode()
            body.append(f'<figure><img alt="{name}" src="data:image/jpeg;base64,{data}"><figcaption>{name}</figure>')
        body.append(f"</div>\n{_html_table([HEAD, *table_rows(photo)])}")
    return _PAGE.format(mark=MARK, body="\n".join(body))


def _html_table(rows: Sequence[tuple[str, ...]]) -> str:
    lines = []
    for number, row in enumerate(rows):
        tag = "td" if number else "th"
        lines.append(f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in row[1:])}</tr>")
    return "\n".join(["<table>", *lines, "</table>"])


def _person_cells(person: PersonPair) -> tuple[str, ...]:
    index = [None if value is None else str(value) for value in person.index]
    distance = [None if value is None else f"{value:.2f} m" for value in person.distance_m]
    contact = [f"{name}: {', '.join(own)}" for name, own in zip("AB", person.contact_of_one, strict=True) if own]
    return (
        _both(*index),
        _both(*person.grade),
        _both(*distance),
        _millimetres(person.joints_m),
        _millimetres(person.pose_m),
        "; ".join(contact).replace("_", " "),
    )


def _both(a: str | None, b: str | None) -> str:
    """Return one text for two equal ones, else "A -> B", with "-" for what is missing."""
    return a or "-" if a == b else f"{a or '-'} -> {b or '-'}"


def _millimetres(metres: float | None) -> str:
    return "-" if metres is None else f"{1000 * metres:.0f} mm"
