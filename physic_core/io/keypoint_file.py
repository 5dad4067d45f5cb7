"""Read keypoints that the user gives: JSON of another program, or CSV with person, joint, x and
y.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.discovery.plugins import absence_message, find_items, import_item
from physic_core.errors import InputError, PackageMissingError
from physic_core.files.atomic import read_text, unreadable
from physic_core.files.text import parse_json, read_csv
from physic_core.io.body_file import WRONG_FORM, scale_of_picture
from physic_core.types.keypoint_table import KeypointRow, KeypointTable
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

_COLUMNS = ("person", "joint", "x", "y")
_SCORE = "confidence"
_DISTRIBUTION = "metricbody-embedded"
_MAX_BYTES = 10_000_000
_LEAST_SCORE = 0.3
_LARGEST_SHARE_PX = 2.0  # all coordinates of a part below it are shares of the picture
_HAND = re.compile("(left|right)_(?:hand|thumb|index|middle|ring|pinky)")


@dataclass(frozen=True)
class GivenKeypoints(ShortRepr):
    """K keypoints that the user gives.

    Attributes:
        person: of each keypoint, its number in the result, or the number of its annotation in the
            file.
        joint: K names.
        points: (K, 2) px.
        has_person_numbers: whether ``person`` is a number in the result; otherwise people are
            matched to annotations.
        file_px_per_px: px of the photo file in one px of ``points``.
        confidence: (K,) in (0, 1], the score of another program, or 1; None if all are 1.
        notes: what was left out or changed when the file was read.
    """

    person: tuple[int, ...]
    joint: tuple[str, ...]
    points: FloatArray
    has_person_numbers: bool
    file_px_per_px: float = 1.0
    confidence: FloatArray | None = None
    notes: tuple[str, ...] = ()

    def moved(self, move: Callable[[FloatArray], FloatArray]) -> GivenKeypoints:
        """Return the keypoints with their pixels (K, 2) mapped by a function."""
        return replace(self, points=move(self.points))


def read_keypoints(path: str, width: int, height: int, photo: str = "") -> GivenKeypoints:
    """Read the keypoints of one photo.

    A third number that is not 0, 1 or 2 makes all of the file scores: keypoints below .3 are left
    out, the others have their score as confidence. Keypoints at (0, 0) in JSON, and those outside
    of the photo, are left out. A file for another size of the same picture is scaled. Each is said
    in a note.

    Args:
        path: of a CSV file with the columns person, joint, x, y and perhaps confidence, or of JSON
            by one of the tools of ``docs/tools.md``.
        width: of the upright photo file, px.
        height: of it, px.
        photo: name of the photo's file, which selects one image of a dataset.

    Raises:
        InputError: the file cannot be read, its format is unknown, it has no keypoints, has one
            twice, is for a picture of another shape, or has most of its keypoints outside of the
            photo.
        PackageMissingError: it is JSON, and no installed plugin reads it.
    """
    try:
        file = Path(path)
        text = read_text(file, _MAX_BYTES)
        is_csv = file.suffix.lower() != ".json"
        table = (
            KeypointTable(tuple(_csv_rows(text)), False)
            if is_csv
            else _table_of(parse_json(text), photo)
        )
        return _given_keypoints(table, is_csv, (width, height))
    except OSError as error:
        raise InputError(f"cannot read the keypoints {path}: {unreadable(error)}") from error
    except WRONG_FORM as error:
        raise InputError(
            f"the keypoints {path} cannot be used (give CSV with the columns "
            f"{', '.join(_COLUMNS)}, COCO JSON, or JSON "
            f"of a tool that docs/tools.md names): {error}"
        ) from error


def _table_of(document: Any, photo: str) -> KeypointTable:
    """Return the keypoints of a JSON document in the form of another program, which a plugin reads
    (hook ``physic_keypoint_readers``).

    Raises:
        ValueError: no plugin knows its form, or one refuses it.
        PackageMissingError: no plugin reads any.
    """
    readers = find_items("physic_keypoint_readers")
    if not readers:
        raise PackageMissingError(f"keypoints in JSON are read by {absence_message(_DISTRIBUTION)}")
    for reader in readers:
        table: KeypointTable | None = import_item(reader, "reader of keypoints")(document, photo)
        if table is not None:
            return table
    raise ValueError(f"its format is unknown: it has {_words_for_document(document)}")


def _words_for_document(document: Any) -> str:
    if isinstance(document, Mapping):
        return f"an object with {', '.join(map(str, list(document)[:6])) or 'nothing'}"
    if isinstance(document, list) and document:
        return (
            f"a list of {len(document)}, the first of which is {_words_for_document(document[0])}"
        )
    return "an empty list" if document == [] else f"a {type(document).__name__}"


def _csv_rows(text: str) -> Iterable[KeypointRow]:
    """Yield the rows below the header; without a column of scores all are visible."""
    for number, row in enumerate(read_csv(text, _COLUMNS, (_SCORE,)), start=1):
        try:
            yield (
                int(row["person"]),
                row["joint"].strip(),
                float(row["x"]),
                float(row["y"]),
                float(row.get(_SCORE, 2.0)),
            )
        except (ValueError, TypeError, AttributeError):
            values = ",".join(str(row[name]) for name in _COLUMNS)
            raise ValueError(
                f"row {number} needs a number, a name and two numbers (got {values})"
            ) from None


def _given_keypoints(table: KeypointTable, is_csv: bool, size: tuple[int, int]) -> GivenKeypoints:
    """Return the keypoints that count, in px of the photo, with notes on what was left out."""
    is_scored = table.scored or any(row[4] not in (0, 1, 2) for row in table.rows)
    # A joint that JSON does not have is at (0, 0), or has no score.
    rows = [row for row in table.rows if is_csv or (row[4] > 0 and row[2:4] != (0, 0))]
    certain = [row for row in rows if row[4] >= (_LEAST_SCORE if is_scored else 1)]
    notes = [*table.notes]
    if unsure := len(rows) - len(certain):
        notes.append(f"left out {unsure} given keypoints whose score is below {_LEAST_SCORE:g}")
    _check_rows(certain)
    points = np.array([row[2:4] for row in certain], np.float64)
    if table.size is not None and table.size != size:
        points = (points + 0.5) * scale_of_picture(table.size, size) - 0.5
        notes.append(
            f"the given keypoints are in px of a picture of {table.size[0]} x {table.size[1]}, "
            f"and were scaled to the "
            f"photo's {size[0]} x {size[1]}"
        )
    inside: BoolArray = np.all((points >= -0.5) & (points < np.array(size) - 0.5), axis=1)
    _check_inside(certain, points, inside, size)
    if outside := int((~inside).sum()):
        notes.append(f"left out {outside} given keypoints outside of the photo")
    if is_scored and (largest := max(row[4] for row in certain)) > 1:
        notes.append(f"scores up to {largest:.3g} were given, and those above 1 count as 1")
    inside_rows = [
        row for row, is_inside in zip(certain, inside.tolist(), strict=True) if is_inside
    ]
    people, joints, _, _, scores = zip(*inside_rows, strict=True)
    confidence = np.clip(np.array(scores, np.float64), 0, 1) if is_scored else None
    return GivenKeypoints(people, joints, points[inside], is_csv, 1.0, confidence, tuple(notes))


def _check_rows(rows: list[KeypointRow]) -> None:
    if not rows:
        raise ValueError("it has no keypoints that are valid")
    (person, joint), count = Counter(row[:2] for row in rows).most_common(1)[0]
    if count > 1:
        raise ValueError(f"the {joint} of person {person} is listed twice")
    if wrong := [row for row in rows if not (math.isfinite(row[2]) and math.isfinite(row[3]))]:
        raise ValueError(f"the {wrong[0][1]} of person {wrong[0][0]} has no finite place")
    parts: dict[tuple[int, str], list[KeypointRow]] = {}
    for row in rows:
        parts.setdefault((row[0], _part(row[1])), []).append(row)
    for (person, part), joint_rows in parts.items():
        values = [value for row in joint_rows for value in row[2:4]]
        # One joint may lie in the corner, at whole pixels.
        is_share = len(joint_rows) > 1 or any(value % 1 for value in values)
        if is_share and max(values) < _LARGEST_SHARE_PX:
            raise ValueError(
                f"all coordinates of the {part} of person {person} are below 2: these look like "
                f"shares of the picture, and px are needed for all people and parts"
            )


def _part(joint: str) -> str:
    """Return the part of a joint, whose unit programs write apart: body, a hand, or the face."""
    match = _HAND.match(joint)
    if match is not None:
        return f"{match[1]} hand"
    return "face" if joint.startswith("face") else "body"


def _check_inside(
    rows: list[KeypointRow], points: FloatArray, inside: BoolArray, size: tuple[int, int]
) -> None:
    if 2 * inside.sum() > len(rows):
        return
    at = int(np.flatnonzero(~inside)[0])
    place = f"the {rows[at][1]} of person {rows[at][0]} at ({points[at, 0]:g}, {points[at, 1]:g})"
    raise ValueError(
        f"{(~inside).sum()} of {len(rows)} keypoints lie outside the photo of {size[0]} x "
        f"{size[1]} px, such as {place}: give px of this photo"
    )
