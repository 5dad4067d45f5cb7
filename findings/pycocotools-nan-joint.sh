#!/bin/sh
# COCOeval for keypoints gets a detection whose 17 joints all lie 500 px off.
# Guessed: average precision 0, also where one of these joints is not known and stands as NaN.
# Measured on 2026-11-27 with pycocotools 2.0.11: 0 without, and 1.0 with one NaN, since no comparison with NaN ends a
# match.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install pycocotools==2.0.11 numpy==2.4.6
python - <<'PYTHON'
import contextlib
import importlib.metadata
import io

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

joints = np.column_stack([np.linspace(50, 250, 17), np.linspace(60, 240, 17), np.full(17, 2.0)])
person = {
    "id": 1, "image_id": 1, "category_id": 1, "iscrowd": 0, "area": 40000.0, "bbox": [50, 50, 200, 200],
    "num_keypoints": 17, "keypoints": joints.ravel().tolist(),
}  # fmt: skip


def average_precision(found):
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO()
        truth.dataset = {"images": [{"id": 1}], "categories": [{"id": 1, "name": "person"}], "annotations": [dict(person)]}
        truth.createIndex()
        answer = {"image_id": 1, "category_id": 1, "score": 0.9, "keypoints": found.ravel().tolist()}
        evaluation = COCOeval(truth, truth.loadRes([answer]), "keypoints")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return float(evaluation.stats[0])


wrong = joints + [500, 0, 0]
unknown = wrong.copy()
unknown[0, :2] = np.nan
finite = average_precision(wrong)
with_nan = average_precision(unknown)
version = importlib.metadata.version("pycocotools")
print(f"pycocotools {version}: average precision {finite:.1f} for 17 wrong joints, {with_nan:.1f} with one of them NaN")
if not (finite < 0.01 and with_nan > 0.99):
    raise SystemExit("the behaviour has changed")
PYTHON
