#!/bin/sh
# A mask of 10 x 10 px, columns 4 to 13, becomes a box, as for a person of a segmentation.
# Guessed: 10 px wide, from 4 to 14, as COCO's own tools have it, so its area is that of the mask.
# Measured on 2026-11-29 with supervision 0.31.2 and imantics 0.1.12: from 4 to 13, so 9 px wide, with an area of 81
# px of their own count, smaller than the mask's 100. supervision's crop of it lacks the last row and column.
# pycocotools 2.0.11 has 10 px.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install supervision==0.31.2 imantics==0.1.12 \
    pycocotools==2.0.11 opencv-python-headless==4.14.0.94 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata

import imantics
import numpy as np
import supervision
from pycocotools import mask as coco

mask = np.zeros((20, 20), bool)
mask[5:15, 4:14] = True
box = supervision.mask_to_xyxy(mask[None])
people = supervision.Detections(xyxy=box.astype(float), mask=mask[None])
own = imantics.Mask(mask).bbox()
crop = supervision.crop_image(mask.astype(np.uint8), box[0])
found = {
    "supervision": (box[0].tolist(), float(people.box_area[0]), crop.shape[:2]),
    "imantics": ([int(edge) for edge in own.bbox()], float(own.area())),
    "pycocotools": coco.toBbox(coco.encode(np.asfortranarray(mask.astype(np.uint8)))).tolist(),
}
versions = {name: importlib.metadata.version(name) for name in found}
print(f"{versions}: {found}")
expected = {
    "supervision": ([4, 5, 13, 14], 81.0, (9, 9)),
    "imantics": ([4, 5, 13, 14], 81.0),
    "pycocotools": [4.0, 5.0, 10.0, 10.0],
}
if found != expected:
    raise SystemExit("the behaviour has changed")
PYTHON
