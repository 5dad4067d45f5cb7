"""COCO: keypoints, boxes and masks of people in px of the photo file, for annotation tools and
evaluation.

Conventions are those of the page "Data format" of COCO: boxes are counted from the corner of the
picture, keypoints from the centre of its first pixel, and run lengths go down the columns.
"""

from __future__ import annotations

import json
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.types import SIDES, skeleton_named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core import Reconstruction
    from physic_core.types import BoolArray, IntArray, Person

_LABELLED = 2
"""Third number of a keypoint.

The result does not say which keypoints something hides, so none is 1.
"""

_CHAINS = (
    ("nose", "{}_eye_inner", "{}_eye", "{}_eye_outer", "{}_ear", "{}_shoulder"),
    ("{}_shoulder", "{}_elbow", "{}_wrist"),
    ("{}_shoulder", "{}_hip", "{}_knee", "{}_ankle"),
    ("{}_ankle", "{}_heel", "{}_foot_tip"),
    ("{}_ankle", "{}_big_toe"),
    ("{}_ankle", "{}_small_toe"),
    *(
        ("{}_wrist", "{}_hand_root", *(f"{{}}_{finger}{part}" for part in ("1", "2", "3", "_tip")))
        for finger in ("thumb", "index", "middle", "ring", "pinky")
    ),
)
"""Points of a side, each of which is linked to the next one that the skeleton has."""

_ACROSS = ("eye", "shoulder", "hip", "mouth_corner")


def export_coco(request: ExportRequest) -> ExportedFiles:
    """Return a COCO file of one image, with an annotation for each person whom the photo shows.

    A keypoint of confidence 0 was not seen: it is 0, 0, 0. The others have visibility 2, and their
    confidence in ``keypoint_scores``. ``person`` is the index into the result.
    """
    result = request.result
    width, height = result.file_size or result.image.shape[1::-1]
    names = [name.removesuffix("_surface") for name in skeleton_named(result.skeleton).names]
    pixels = _image_pixels(result, width, height)
    visible_people = [(index, person) for index, person in request.chosen() if person.mask.any()]
    document = {
        "info": {"description": "PhySIC"},
        "images": [{"id": 1, "file_name": result.photo_name, "width": width, "height": height}],
        "categories": [
            {
                "id": 1,
                "name": "person",
                "supercategory": "person",
                "keypoints": names,
                "skeleton": skeleton_links(names),
            }
        ],
        "annotations": [
            _coco_annotation(result, index, person, pixels) for index, person in visible_people
        ],
    }
    notes = [
        f"person {index} is not in the photo and is left out"
        for index in request.person
        if index not in dict(visible_people)
    ]
    if not result.photo_name:
        notes.append("the photo had no file: set file_name of the image")
    return ExportedFiles(
        {f"{request.stem}{request.suffix}": (json.dumps(document) + "\n").encode()}, tuple(notes)
    )


def skeleton_links(names: Sequence[str]) -> list[list[int]]:
    """Return the pairs of keypoints between which tools draw a line, counted from 1."""
    number = {name: place for place, name in enumerate(names, 1)}
    links = []
    for chain in _CHAINS:
        for side in SIDES:
            there = [number[name] for part in chain if (name := part.format(side)) in number]
            links += [list(pair) for pair in pairwise(there)]
    for part in _ACROSS:
        if all(f"{side}_{part}" in number for side in SIDES):
            links.append([number[f"{side}_{part}"] for side in SIDES])
    return links


def _coco_annotation(
    result: Reconstruction, index: int, person: Person, pixels: tuple[IntArray, IntArray]
) -> dict[str, Any]:
    is_visible = person.keypoint_confidence > 0
    points = np.where(is_visible[:, None], result.file_pixels(person.keypoints), 0.0)
    triples = np.column_stack([points.round(4), np.where(is_visible, _LABELLED, 0)])
    x0, y0, x1, y1 = person.box.astype(np.float64) - 0.5
    corners = result.file_pixels(np.array([[x0, y0], [x1, y0], [x0, y1], [x1, y1]])) + 0.5
    low = corners.min(0)
    mask = _mask_of_file(person.mask, pixels)
    return {
        "id": index + 1,
        "image_id": 1,
        "category_id": 1,
        "person": index,
        "bbox": [*low.round(4).tolist(), *(corners.max(0) - low).round(4).tolist()],
        "area": int(mask.sum()),
        "segmentation": {"size": list(mask.shape), "counts": run_lengths(mask)},
        "iscrowd": 0,
        "score": round(float(person.score), 4),
        "num_keypoints": int(is_visible.sum()),
        "keypoints": [
            int(value) if value.is_integer() else value for value in triples.ravel().tolist()
        ],
        "keypoint_scores": person.keypoint_confidence.astype(np.float64).round(4).tolist(),
    }


def run_lengths(mask: BoolArray) -> list[int]:
    """Return the lengths of runs of equal pixels down the columns of a mask (H, W), beginning with
    those outside.
    """
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    lengths: list[int] = np.diff(changes, prepend=0, append=flat.size).tolist()
    return [0, *lengths] if flat[0] else lengths


def _image_pixels(result: Reconstruction, width: int, height: int) -> tuple[IntArray, IntArray]:
    """Return rows and columns of ``image`` that show the pixels of the file, which broadcast to
    (height, width).
    """
    rows = np.arange(height)[:, None]
    columns = np.arange(width)[None]
    if result.lens is None:
        return rows * len(result.image) // height, columns * result.image.shape[1] // width
    from physic_core.geometry import undistort_pixels

    original = result.lens.intrinsics
    camera = result.intrinsics
    distorted = np.stack(np.broadcast_arrays(columns, rows), -1).reshape(-1, 2)
    x, y = undistort_pixels(distorted.astype(np.float64), original, result.lens.distortion).T
    image_positions = (
        (y - original.cy) / original.fy * camera.fy + camera.cy,
        (x - original.cx) / original.fx * camera.fx + camera.cx,
    )
    pixels = [np.rint(values).astype(np.int64).reshape(height, width) for values in image_positions]
    return pixels[0], pixels[1]


def _mask_of_file(mask: BoolArray, pixels: tuple[IntArray, IntArray]) -> BoolArray:
    rows, columns = pixels
    inside = (rows >= 0) & (rows < mask.shape[0]) & (columns >= 0) & (columns < mask.shape[1])
    file_mask: BoolArray = (
        mask[rows.clip(0, mask.shape[0] - 1), columns.clip(0, mask.shape[1] - 1)] & inside
    )
    return file_mask
