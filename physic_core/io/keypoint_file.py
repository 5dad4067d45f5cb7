"""Read keypoints that the user gives: COCO JSON, or CSV with person, joint, x and y."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_core.files.text import parse_json, quoted
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SKELETONS

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_COLUMNS = ("person", "joint", "x", "y")
_COCO = tuple(name.removesuffix("_surface") for name in SKELETONS["coco17"].names)
_MAX_BYTES = 10_000_000

Row = tuple[int, str, float, float]


@dataclass(frozen=True)
class GivenKeypoints(ShortRepr):
    """K keypoints that the user gives.

    Attributes:
        person: of each keypoint, its number in the result, or the number of its annotation in the file.
        joint: K names.
        points: (K, 2) px.
        numbered: whether ``person`` is a number in the result; otherwise people are matched to annotations.
        file_px: px of the photo file in one px of ``points``.
    """

    person: tuple[int, ...]
    joint: tuple[str, ...]
    points: FloatArray
    numbered: bool
    file_px: float = 1.0

    def moved(self, move: Callable[[FloatArray], FloatArray]) -> GivenKeypoints:
        """Return the keypoints with their pixels (K, 2) mapped by a function."""
        return replace(self, points=move(self.points))


def read_keypoints(path: str, width: int, height: int) -> GivenKeypoints:
    """Read the keypoints of one photo.

    Args:
        path: of a CSV file with the columns person, joint, x and y, or of COCO JSON: a dataset, its annotations, or
            results of a detector. Points with v = 0 are skipped.
        width: of the upright photo file, px.
        height: of it, px.

    Raises:
        InputError: the file cannot be read, has no keypoints, has one twice, or has one outside of the photo.
    """
    try:
        file = Path(path)
        if file.stat().st_size > _MAX_BYTES:
            raise ValueError(f"it has more than {_MAX_BYTES / 1e6:.0f} MB, and keypoints of one photo are smaller")
        text = file.read_text(encoding="utf-8-sig")
        is_csv = file.suffix.lower() != ".json"
        rows = list(_csv_rows(text) if is_csv else _coco_rows(parse_json(text)))
        _check_rows(rows, width, height)
    except OSError as error:
        raise InputError(f"cannot read the keypoints {path}: {error.strerror}") from error
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"the keypoints {path} cannot be used: {error}; give CSV with the columns {', '.join(_COLUMNS)}, or COCO "
            "JSON"
        ) from error
    people, joints, x, y = zip(*rows, strict=True)
    return GivenKeypoints(people, joints, np.stack([x, y], -1).astype(np.float64), is_csv)


def _csv_rows(text: str) -> Iterable[Row]:
    """Yield person, joint, x and y of each line below the header."""
    lines = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    if missing := [name for name in _COLUMNS if name not in (lines.fieldnames or ())]:
        raise ValueError(f"the first line lacks {', '.join(missing)} (got {quoted(text.split(chr(10))[0])})")
    for line in lines:
        try:
            yield int(line["person"]), line["joint"].strip(), float(line["x"]), float(line["y"])
        except (ValueError, TypeError, AttributeError):
            given = ",".join(str(line[name]) for name in _COLUMNS)
            raise ValueError(f"line {lines.line_num} needs a number, a name and two numbers (got {given})") from None


def _coco_rows(table: Any) -> Iterable[Row]:
    """Yield number, joint, x and y of each visible keypoint of each annotation."""
    annotations = table.get("annotations") if isinstance(table, Mapping) else table
    if not isinstance(annotations, list) or not all(isinstance(one, Mapping) for one in annotations):
        raise ValueError("it has no list of annotations")
    images = {one.get("image_id") for one in annotations}
    if len(images) > 1:
        raise ValueError(f"it has annotations of {len(images)} images: keep those of this photo")
    categories = table.get("categories") if isinstance(table, Mapping) else None
    names = {one["id"]: one["keypoints"] for one in categories or () if one.get("keypoints")}
    for number, one in enumerate(annotations):
        joints = names.get(one.get("category_id"), _COCO)
        numbers = one.get("keypoints") or ()
        if len(numbers) not in (0, 3 * len(joints)):
            raise ValueError(f"annotation {number} has {len(numbers)} numbers for {len(joints)} keypoints of x, y, v")
        for row, joint in enumerate(joints):
            x, y, visible = map(float, numbers[3 * row : 3 * row + 3] or (0, 0, 0))
            if visible > 0:
                yield number, str(joint), x, y


def _check_rows(rows: list[Row], width: int, height: int) -> None:
    if not rows:
        raise ValueError("it has no keypoints")
    seen = set()
    for person, joint, x, y in rows:
        if (person, joint) in seen:
            raise ValueError(f"the {joint} of person {person} comes twice")
        seen.add((person, joint))
        if not (math.isfinite(x) and math.isfinite(y) and -0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
            raise ValueError(
                f"the {joint} of person {person} at ({x:g}, {y:g}) lies outside of the photo of {width} x {height} px"
            )
