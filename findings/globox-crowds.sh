#!/bin/sh
# A COCO file has a person and a crowd (iscrowd 1), which an evaluation does not count as missed. globox reads the
# file and writes it as COCO.
# Guessed: the crowd stays a crowd, and the annotations keep their numbers.
# Measured on 2026-11-28 with globox 2.9.0 and pycocotools 2.0.11: the crowd becomes a person, and numbers begin at 0,
# where COCOeval takes a match for none. So the average precision of a perfect detection falls from 1 to 0; with
# numbers from 1 it is .5.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install globox==2.9.0 pycocotools==2.0.11 numpy==2.4.6
python - <<'PYTHON'
import contextlib
import importlib.metadata
import io
import json

import globox
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

person = {"id": 11, "image_id": 7, "category_id": 1, "bbox": [10, 10, 20, 60], "area": 900, "iscrowd": 0}
crowd = {"id": 12, "image_id": 7, "category_id": 1, "bbox": [40, 0, 60, 80], "area": 4000, "iscrowd": 1}
data = {
    "images": [{"id": 7, "file_name": "a.png", "width": 100, "height": 80}],
    "categories": [{"id": 1, "name": "person"}],
    "annotations": [person, crowd],
}
with open("in.json", "w", encoding="utf-8") as file:
    json.dump(data, file)
globox.AnnotationSet.from_coco("in.json").save_coco("out.json")


def precision(path):
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO(path)
        found = truth.loadRes([{"image_id": 7, "category_id": 1, "bbox": person["bbox"], "score": 0.9}])
        evaluation = COCOeval(truth, found, "bbox")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return round(float(evaluation.stats[0]), 2)


with open("out.json", encoding="utf-8") as file:
    written = json.load(file)
made = [(one["id"], one["iscrowd"]) for one in written["annotations"]]
for one in written["annotations"]:
    one["id"] += 1
with open("from_1.json", "w", encoding="utf-8") as file:
    json.dump(written, file)
before = precision("in.json")
after = precision("out.json")
from_1 = precision("from_1.json")
version = importlib.metadata.version("globox")
print(f"globox {version}: number and iscrowd {made}; average precision {before}, then {after}, {from_1} from 1")
if not (made == [(0, 0), (1, 0)] and before == 1 and after == 0 and 0.45 < from_1 < 0.55):
    raise SystemExit("the behaviour has changed")
PYTHON
