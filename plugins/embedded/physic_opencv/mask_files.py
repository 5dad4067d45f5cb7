"""Masks of one photo as other programs write them: which form it is, and the masks of each form."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_core.files import ImageSource, count, decode, matrix, number, open_image, read_text
from physic_core.types import FileOfPhoto, MasksInFile
from physic_opencv.documents import open_document
from physic_opencv.keypoint_files import annotations_of_photo, by_id, id_of, stated_size

if TYPE_CHECKING:
    from physic_core.types import AnyArray, BoolArray


_PERSON = "person"
_COCO_PERSON = "1"
_MAX_TEXT = 100_000_000
_FARTHEST_PX = 1e6
_VOID = 255
_MAX_PIXELS = 1 << 28


def masks_of(file: FileOfPhoto) -> MasksInFile | None:
    """Return the masks of a file or folder; None if its format is unknown.

    Raises:
        ValueError: the form is known and refused.
    """
    path = file.path
    if path.is_dir():
        return _read_folder(path)
    suffix = path.suffix.lower()
    if suffix == ".txt":
        return MasksInFile(_polygons_of_text(read_text(path, _MAX_TEXT), file.size))
    if suffix == ".png":
        return MasksInFile(_masks_of_labels(_picture(path)))
    document = open_document(path)
    if suffix == ".json":
        return _masks_of_json(document, file)
    return MasksInFile(_masks_of_arrays(document))


def _read_folder(path: Path) -> MasksInFile:
    """Read a folder with a picture for each mask; with SAM's table, the masks are of all things."""
    pictures = [_picture(one) > 0 for one in sorted(path.glob("*.png"))]
    if not pictures:
        raise ValueError("it has no .png in it")
    return MasksInFile(np.stack(pictures), not (path / "metadata.csv").is_file())


def _picture(path: Path) -> AnyArray:
    """Return the labels (H, W) of a picture of one channel or a palette."""
    source = ImageSource(str(path), path=path, role="mask", formats="a PNG of labels")
    with open_image(source) as (image, _):
        decode(image, source)
        if image.mode not in ("1", "L", "P", "I", "I;16"):
            raise ValueError(
                f"{path.name} is a picture of colors ({image.mode}): give a palette or one "
                f"channel, whose values number the people"
            )
        return np.asarray(image)


def _masks_of_labels(labels: AnyArray) -> BoolArray:
    """Return a mask (N, H, W) of each label above 0, but not of 255 after 1, 2, ..., which data
    sets give to borders.
    """
    ids = np.unique(labels).tolist()
    if len(ids) > 256:
        raise ValueError(f"it has {len(ids)} labels: is it a photo or a depth map?")
    people = [one for one in ids if one > 0]
    if len(people) > 1 and people == [*range(1, len(people)), _VOID]:
        people.pop()
    return np.stack([labels == one for one in people] or [labels > 0])


def _masks_of_arrays(document: Any) -> BoolArray:
    """Return the masks of an array (N, H, W) or (H, W), alone or in an npz."""
    if isinstance(document, Mapping):
        fit = [v for v in document.values() if isinstance(v, np.ndarray) and v.ndim in (2, 3, 4)]
        document = document.get("masks", fit[0] if len(fit) == 1 else None)
    fits = isinstance(document, np.ndarray) and document.ndim in (2, 3, 4)
    if not fits or document.dtype.kind not in "biuf":
        raise ValueError('it has no array "masks" (N, H, W) of numbers')
    if document.ndim == 4:
        document = document[:, 0]
    if document.ndim == 2:
        return _masks_of_labels(document)
    return np.asarray(document > (0 if document.dtype.kind in "bu" else 0.5))


def _masks_of_json(document: Any, file: FileOfPhoto) -> MasksInFile:
    """Read a COCO dataset, its annotations or results, or SAM's list of masks."""
    dataset = document if isinstance(document, Mapping) else {}
    entries = dataset.get("annotations", document)
    if not isinstance(entries, list) or not all(
        isinstance(one, Mapping) and "segmentation" in one for one in entries
    ):
        raise ValueError("it has no list of annotations with a segmentation")
    if any("predicted_iou" in one for one in entries):
        return MasksInFile(_masks_of_entries(entries, file.size), are_people=False)
    images = by_id(dataset, "images")
    image, annotations = annotations_of_photo(entries, images, file.photo)
    size = stated_size(images.get(image, {}), "width", "height") or file.size
    _check_size(*size)
    categories = by_id(dataset, "categories")
    people = {key for key, one in categories.items() if one.get("name") == _PERSON}
    chosen = [
        one for one in annotations if id_of(one, "category_id") in (people or {_COCO_PERSON, ""})
    ]
    if not chosen:
        raise ValueError(f"it has {len(annotations)} annotations of the photo, and no person")
    chosen.sort(key=lambda one: -number(one.get("score", 1), "score"))
    left_out = len(annotations) - len(chosen)
    notes = (f"left out {left_out} given masks of other things than people",) * bool(left_out)
    return MasksInFile(_masks_of_entries(chosen, size), notes=notes)


def _masks_of_entries(entries: list[Any], size: tuple[int, int]) -> BoolArray:
    return np.stack([_decode_mask(one["segmentation"], size) for one in entries])


def _decode_mask(segmentation: Any, size: tuple[int, int]) -> BoolArray:
    """Return the mask (H, W) of polygons, or of run lengths that are by column."""
    if isinstance(segmentation, list):
        return _union_of_polygons(
            [matrix(one, "a polygon").reshape(-1, 2) for one in segmentation], size
        )
    height, width = (count(side, "a side") for side in segmentation["size"])
    _check_size(width, height)
    counts = segmentation["counts"]
    runs = (
        _run_lengths(counts)
        if isinstance(counts, str)
        else [count(one, "a run length") for one in counts]
    )
    if sum(runs) != height * width:
        raise ValueError(f"run lengths are of {sum(runs)} px, and the size is {width} x {height}")
    values = np.arange(len(runs)) % 2 == 1
    return np.repeat(values, runs).reshape(width, height).T


def _check_size(width: int, height: int) -> None:
    if min(width, height) < 1 or width * height > _MAX_PIXELS:
        raise ValueError(f"it is of a picture of {width} x {height} px")


def _run_lengths(text: str) -> list[int]:
    """Return the numbers of COCO's text: five bits a character from "0" on, differences from the
    number before the last after the first three.
    """
    runs: list[int] = []
    value = bits = 0
    for character in text:
        part = ord(character) - 48
        value |= (part & 31) << bits
        bits += 5
        if part & 32:
            continue
        if part & 16:
            value -= 1 << bits
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = bits = 0
    return runs


def _union_of_polygons(polygons: list[AnyArray], size: tuple[int, int]) -> BoolArray:
    """Return the union (H, W) of polygons (n, 2) in px from the corner of the picture."""
    import cv2

    mask = np.zeros(size[::-1], np.uint8)
    for points in polygons:
        if len(points) < 3:
            raise ValueError(f"a polygon has {len(points)} points, and at least 3 are needed")
        if np.abs(points).max() > _FARTHEST_PX:
            raise ValueError(f"a polygon has a point at {np.abs(points).max():g} px")
        cv2.fillPoly(mask, [np.rint(np.asarray(points, np.float64) - 0.5).astype(np.int32)], 1)
    return mask > 0


def _polygons_of_text(text: str, size: tuple[int, int]) -> BoolArray:
    """Read Ultralytics' lines: class, x and y of each point as shares, perhaps confidence and
    id.
    """
    masks = []
    for line_number, line in enumerate(text.splitlines(), start=1):
        values = [float(part) for part in line.split()]
        if not values or values[0] != 0:  # class 0 is the person
            continue
        shares = values[1:]
        if len(shares) % 2 == 0 and shares[-1] > 1:  # confidence and id
            del shares[-2:]
        del shares[len(shares) // 2 * 2 :]
        if len(shares) < 6 or not all(-0.01 <= share <= 1.01 for share in shares):
            raise InputError(
                f"line {line_number} of the masks is not a polygon with coordinates from 0 to 1"
            )
        masks.append(_union_of_polygons([np.reshape(shares, (-1, 2)) * size], size))
    if not masks:
        raise ValueError("it has no line of class 0, a person")
    return np.stack(masks)
