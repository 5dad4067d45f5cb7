#!/bin/sh
# labelme marks the two parts of a person behind a post as polygons of one group_id; a rectangle marks a second
# person, and a point an ankle. labelme2coco makes COCO of it.
# Guessed: two people, the first with two polygons; the point is left out.
# Measured on 2026-11-28 with labelme2coco 0.2.6: four people. The parts are two, and the point is one of 1 x 1 px;
# group_id is not read. The rectangle has an empty segmentation, so it has no mask.
# Readers guessed: wrong, in part, wrong.
. "$(dirname "$0")/common.sh"
install labelme2coco==0.2.6 sahi==0.12.8 numpy==2.3.5
python -W ignore - 2> log.txt <<'PYTHON'
import importlib.metadata
import json
import os

from labelme2coco import get_coco_from_labelme_folder
from PIL import Image


def shape(kind, points, group):
    return {"label": "person", "points": points, "shape_type": kind, "group_id": group, "flags": {}}


shapes = [
    shape("polygon", [[10, 10], [20, 10], [20, 30], [10, 30]], 1),
    shape("polygon", [[25, 10], [35, 10], [35, 30], [25, 30]], 1),
    shape("rectangle", [[50, 10], [60, 40]], 2),
    shape("point", [[15, 29]], 1),
]
document = {"version": "6.3.1", "flags": {}, "imagePath": "a.png", "imageData": None}
document.update(imageHeight=80, imageWidth=100, shapes=shapes)
os.mkdir("in")
Image.new("RGB", (100, 80)).save("in/a.png")
with open("in/a.json", "w", encoding="utf-8") as file:
    json.dump(document, file)
made = get_coco_from_labelme_folder("in").json["annotations"]
found = [([round(value) for value in one["bbox"]], len(one["segmentation"])) for one in made]
version = importlib.metadata.version("labelme2coco")
print(f"labelme2coco {version}: boxes, polygons: {found}")
if found != [([10, 10, 10, 20], 1), ([25, 10, 10, 20], 1), ([50, 10, 10, 30], 0), ([15, 29, 1, 1], 0)]:
    raise SystemExit("the behaviour has changed")
PYTHON
