#!/bin/sh
# COCO keypoints of a person: the nose is visible (2), the left wrist hidden (1), the right wrist not in the picture (0,
# at 0, 0). Datumaro reads them, which keeps all three, and writes them for CVAT, to be corrected by hand.
# Guessed: CVAT's file marks the hidden and the absent joint ("occluded", "outside"), or leaves the absent one out.
# Measured on 2026-12-01 with datumaro 1.13.12: three points without a mark. Read again, all three are visible, the
# right wrist at the corner of the picture.
# Readers guessed: wrong, right, wrong.
. "$(dirname "$0")/common.sh"
install datumaro==1.13.12 numpy==2.3.5
python -W ignore - 2> log.txt <<'PYTHON' || { tail -n 3 log.txt; exit 1; }
import json
from importlib.metadata import version
from pathlib import Path

import datumaro
from PIL import Image

Path("coco/annotations").mkdir(parents=True)
Path("coco/images/val").mkdir(parents=True)
Image.new("RGB", (64, 48)).save("coco/images/val/photo.jpg")
person = {
    "id": 1,
    "image_id": 1,
    "category_id": 1,
    "iscrowd": 0,
    "bbox": [5, 5, 20, 20],
    "area": 400,
    "keypoints": [10, 10, 2, 20, 12, 1, 0, 0, 0],
    "num_keypoints": 2,
    "segmentation": [[5, 5, 25, 5, 25, 25, 5, 25]],
}
category = {"id": 1, "name": "person", "keypoints": ["nose", "left_wrist", "right_wrist"], "skeleton": [[1, 2], [1, 3]]}
image = {"id": 1, "file_name": "photo.jpg", "width": 64, "height": 48}
content = {"images": [image], "annotations": [person], "categories": [category]}
Path("coco/annotations/person_keypoints_val.json").write_text(json.dumps(content))


def visibilities(data: datumaro.Dataset) -> list[int]:
    return [
        int(value)
        for item in data
        for part in item.annotations
        if isinstance(part, datumaro.Points)
        for value in part.visibility
    ]


data = datumaro.Dataset.import_from("coco", "coco_person_keypoints")
data.export("cvat", "cvat", save_media=True)
written = next(Path("cvat").rglob("*.xml")).read_text()
marks = [word for word in ('outside="1"', 'occluded="1"', "<skeleton") if word in written]
again = visibilities(datumaro.Dataset.import_from("cvat", "cvat"))
print(f"datumaro {version('datumaro')}: read {visibilities(data)}; marks in CVAT's file {marks}; read again {again}")
if visibilities(data) != [2, 1, 0] or marks or again != [2, 2, 2]:
    raise SystemExit("the behaviour has changed")
PYTHON
