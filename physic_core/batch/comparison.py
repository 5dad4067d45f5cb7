"""Compare two results of one photo person by person, and two folders of results photo by photo; tables and a page."""

from __future__ import annotations

import base64
import html
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from physic_core.batch.contact_sheet import find_results
from physic_core.errors import InputError
from physic_core.files.atomic import MARK
from physic_core.io.result_folder import is_result, photo_identity_of_result
from physic_core.metrics import BODY_JOINTS, match_by_masks, mpjpe_mm, scene_error
from physic_core.types.results import pelvis_distance_m

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Grade, Person, Reconstruction

HEAD = ("photo", "person", "grade", "distance", "joints", "pose", "contact that one has alone")

PICTURE_HEIGHT = 320
"""Height of the pictures on the page, px."""

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


@dataclass(frozen=True)
class PersonPair:
    """One person of two results A and B; pairs of values are in this order, None where a result has none.

    Attributes:
        index: of the person in each result; None in the one that has no such person.
        grade: of the person.
        distance_m: of the pelvis from the camera.
        joints_m: mean distance of the 22 joints from pelvis to wrists; None without two bodies.
        pose_m: the same with both pelvises in one place.
        contact_of_one: likely contacts that only this result has, such as "left_hand: floor".
    """

    index: tuple[int | None, int | None]
    grade: tuple[str | None, str | None]
    distance_m: tuple[float | None, float | None]
    joints_m: float | None
    pose_m: float | None
    contact_of_one: tuple[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True)
class Comparison:
    """Two results A and B of one photo.

    Attributes:
        photo: name for readers.
        grade: of each result.
        focal_px: focal length of each camera.
        depth_ratio: median depth of the scene of B over that of A, over the pixels that both know; None without.
        depth_difference: median of the relative difference of depth of one pixel.
        people: those of A, then those that only B has.
    """

    photo: str
    grade: tuple[str | None, str | None]
    focal_px: tuple[float, float]
    depth_ratio: float | None
    depth_difference: float | None
    people: tuple[PersonPair, ...]


@dataclass(frozen=True)
class PairedFolders:
    """Folders of the results in two folders A and B, paired by photo.

    Attributes:
        both: (result in A, result in B) of each photo that both folders hold.
        only: (results only in A, results only in B).
    """

    both: tuple[tuple[Path, Path], ...]
    only: tuple[tuple[Path, ...], tuple[Path, ...]]


def pair_results(a: Path, b: Path) -> PairedFolders:
    """Find the results of the same photos, by the digests of the photos. Two results of one photo each are one pair.

    Args:
        a: folder of a result, or of a batch, or of results.
        b: the same.

    Raises:
        InputError: a folder has no result.
    """
    if is_result(a) and is_result(b):
        return PairedFolders(((a, b),), ((), ()))
    found = _by_photo(a), _by_photo(b)
    both = tuple((folder, found[1][key]) for key, folder in found[0].items() if key in found[1])
    only = [tuple(folder for key, folder in one.items() if key not in other) for one, other in (found, found[::-1])]
    return PairedFolders(both, (only[0], only[1]))


def compare_results(photo: str, a: Reconstruction, b: Reconstruction) -> Comparison:
    """Compare two results of one photo, whose name is given; people are matched by their masks.

    Raises:
        InputError: the pictures have different sizes.
    """
    sizes = [f"{one.intrinsics.width} x {one.intrinsics.height}" for one in (a, b)]
    if sizes[0] != sizes[1]:
        raise InputError(f"the results are of {sizes[0]} and {sizes[1]} px: compare two results of one photo")
    matching = match_by_masks(_masks(b), _masks(a))
    partner = matching.predicted_of
    known = [_pair(a, b, index, partner.get(index)) for index in range(len(a.people))]
    added = [_pair(a, b, None, int(index)) for index in matching.false_alarms]
    error = scene_error(b.scene.points, a.scene.points, b.scene.valid, a.scene.valid)
    return Comparison(
        photo,
        (_text(a.grade), _text(b.grade)),
        (a.intrinsics.fx, b.intrinsics.fx),
        _known(math.exp(error.log_scale)),
        _known(error.depth_relative_median),
        (*known, *added),
    )


def table_rows(photo: Comparison) -> list[tuple[str, ...]]:
    """Return the rows of a photo, with the columns of :data:`HEAD`: one of the scene, then one of each person."""
    scene = "-" if photo.depth_ratio is None else f"depth x {photo.depth_ratio:.2f}"
    return [
        (photo.photo, "scene", _both(*photo.grade), scene, "", "", ""),
        *((photo.photo, *_person_cells(person)) for person in photo.people),
    ]


def summary_lines(photos: Sequence[Comparison], only: tuple[Sequence[Path], Sequence[Path]]) -> list[str]:
    """Return sentences about all photos, and about the photos with a result in only one folder."""
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


def comparison_page(
    photos: Sequence[Comparison], pictures: Sequence[Sequence[bytes]], names: tuple[str, str], lines: Sequence[str]
) -> str:
    """Return the page.

    Args:
        photos: all comparisons.
        pictures: thumbnails of A and B of each, :data:`PICTURE_HEIGHT` px high.
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


def _by_photo(folder: Path) -> dict[tuple[str, int], Path]:
    """Return the results below a folder by digest of the photo; equal photos are numbered."""
    counts = Counter[str]()
    found = {}
    for result in find_results(folder):
        photo = photo_identity_of_result(result) or str(result.relative_to(folder))
        found[photo, counts[photo]] = result
        counts[photo] += 1
    return found


def _masks(result: Reconstruction) -> BoolArray:
    none = np.zeros((0, *result.image.shape[:2]), bool)
    return np.concatenate([none, *(person.mask[None] for person in result.people)])


def _pair(a: Reconstruction, b: Reconstruction, first: int | None, second: int | None) -> PersonPair:
    one = None if first is None else a.people[first]
    other = None if second is None else b.people[second]
    contacts = _contacts(one), _contacts(other)
    joints = pose = None
    if one is not None and other is not None:
        joints = _joints_off_m(one.joints, other.joints)
        pose = _joints_off_m(one.joints - one.joints[:1], other.joints - other.joints[:1])
    return PersonPair(
        index=(first, second),
        grade=(None if one is None else _text(one.grade), None if other is None else _text(other.grade)),
        distance_m=(
            None if one is None else pelvis_distance_m(one),
            None if other is None else pelvis_distance_m(other),
        ),
        joints_m=joints,
        pose_m=pose,
        contact_of_one=(tuple(sorted(contacts[0] - contacts[1])), tuple(sorted(contacts[1] - contacts[0]))),
    )


def _contacts(person: Person | None) -> set[str]:
    """Return likely contacts as "part: kind"; the numbers of surfaces and people differ between results."""
    return set() if person is None else {f"{c.part}: {c.partner.kind}" for c in person.contacts if c.likely}


def _joints_off_m(one: FloatArray, other: FloatArray) -> float | None:
    return _known(float(mpjpe_mm(one[BODY_JOINTS], other[BODY_JOINTS])) / 1000)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _text(grade: Grade | None) -> str | None:
    return None if grade is None else str(grade)


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
