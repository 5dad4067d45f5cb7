"""COCO JSON: boxes, masks and 17 keypoints of the people, with a PNG of each reconstructed image."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.types.skeletons import SKELETONS, skeleton_named

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Detection, UInt8Array

_VISIBLE_CONFIDENCE = 0.5
"""Minimum confidence of a keypoint that is labelled as visible (v = 2)."""

_BONES = (
    *((16, 14), (14, 12), (17, 15), (15, 13), (12, 13), (6, 12), (7, 13), (6, 7), (6, 8), (7, 9)),
    *((8, 10), (9, 11), (2, 3), (1, 2), (1, 3), (2, 4), (3, 5), (4, 6), (5, 7)),
)


def export_coco(request: ExportRequest) -> ExportedFiles:
    """Return the JSON and a PNG of each photo's image.

    Boxes are x, y, width and height; keypoints are pixel indices, as in
    COCO. Segmentations are run lengths (``iscrowd`` 0). A keypoint has v = 2 from a confidence of 0.5, v = 1 below that
    and v = 0 if it was not detected.
    """
    result, stem = request.result, request.stem
    cameras = result.cameras or (result.reference_view(),)
    files = [f"{stem}_{number}.png" if number else f"{stem}.png" for number in range(len(cameras))]
    names = [name.removesuffix("_surface") for name in SKELETONS["coco17"].names]
    document = {
        "info": {
            "description": "PhySIC; the image is the photo as reconstructed: upright, without lens distortion",
            "version": "1",
        },
        "licenses": [],
        "images": [
            {"id": number, "file_name": name, "width": camera.intrinsics.width, "height": camera.intrinsics.height}
            for number, (name, camera) in enumerate(zip(files, cameras, strict=True), start=1)
        ],
        "categories": [{"id": 1, "name": "person", "supercategory": "person", "keypoints": names, "skeleton": _BONES}],
        "annotations": [
            _annotation(request, number, index, camera.people[index])
            for number, camera in enumerate(cameras)
            for index in request.people
            if index in camera.people
        ],
    }
    text = json.dumps(document, allow_nan=False).encode()
    images = {name: _png(camera.image) for name, camera in zip(files, cameras, strict=True)}
    return ExportedFiles({f"{stem}{request.suffix}": text, **images})


def _annotation(request: ExportRequest, photo: int, index: int, person: Detection) -> dict[str, Any]:
    """Return the entry of a person in a photo; indices from 0."""
    x0, y0, x1, y1 = (float(edge) for edge in person.box)
    keypoints = _keypoints(request, person)
    return {
        "id": 1 + index + photo * len(request.result.people),
        "image_id": photo + 1,
        "category_id": 1,
        "iscrowd": 0,
        "bbox": [round(v, 2) for v in (x0, y0, x1 - x0, y1 - y0)],
        "area": int(person.mask.sum()),
        "segmentation": run_lengths(person.mask),
        "keypoints": [round(number, 2) for point in keypoints for number in point],
        "num_keypoints": sum(point[2] > 0 for point in keypoints),
        "score": round(float(person.score), 4),
        "person": index,
    }


def _keypoints(request: ExportRequest, person: Detection) -> list[tuple[float, float, int]]:
    """Return x, y, v of the 17 keypoints; 0, 0, 0 for those that the detector does not have."""
    place = {name: row for row, name in enumerate(skeleton_named(request.result.skeleton).names)}
    points: list[tuple[float, float, int]] = []
    for name in SKELETONS["coco17"].names:
        row = place.get(name)
        confidence = 0.0 if row is None else float(person.keypoint_confidence[row])
        if row is None or not confidence > 0 or not np.isfinite(person.keypoints[row]).all():
            points.append((0, 0, 0))
            continue
        x, y = (float(v) for v in person.keypoints[row])
        points.append((x, y, 2 if confidence >= _VISIBLE_CONFIDENCE else 1))
    return points


def run_lengths(mask: BoolArray) -> dict[str, Any]:
    """Return COCO's uncompressed RLE of a mask (H, W): lengths of runs of 0 and 1 in turn, column by column."""
    flat = np.concatenate([[False], mask.T.reshape(-1)])
    starts = np.flatnonzero(flat[1:] != flat[:-1])
    return {"size": list(mask.shape), "counts": np.diff([0, *starts.tolist(), mask.size]).tolist()}


def _png(image: UInt8Array) -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG")
    return stream.getvalue()
