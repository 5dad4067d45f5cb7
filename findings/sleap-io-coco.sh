#!/bin/sh
# sleap-io loads COCO keypoints of a person with box and mask, and saves them as COCO. One keypoint is hidden
# (visibility 1).
# Guessed: visibility, box and mask come back.
# Measured on 2026-11-28 with sleap-io 0.9.5: visibility 1 becomes 2, the box and the area are those around the
# keypoints, and the mask is left out. It reports none of them. A keypoint that is not known (0) comes back as 0.
# Readers guessed: right, right, in part.
. "$(dirname "$0")/common.sh"
install sleap-io==0.9.5 numpy==2.4.6
python -W ignore - <<'PYTHON'
import json

import sleap_io
from PIL import Image

Image.new("RGB", (200, 100)).save("a.png")
person = {"id": 1, "image_id": 1, "category_id": 1, "bbox": [10, 10, 100, 80], "area": 8000, "iscrowd": 0}
person["segmentation"] = [[10, 10, 110, 10, 110, 90, 10, 90]]
person["keypoints"] = [20, 20, 2, 40, 30, 1, 0, 0, 0, 60, 70, 2]
person["num_keypoints"] = 3
names = ["head", "hip", "hand", "foot"]
category = {"id": 1, "name": "person", "keypoints": names, "skeleton": [[1, 2], [2, 4]]}
data = {"images": [{"id": 1, "file_name": "a.png", "width": 200, "height": 100}], "categories": [category]}
with open("in.json", "w", encoding="utf-8") as file:
    json.dump({**data, "annotations": [person]}, file)
sleap_io.save_coco(sleap_io.load_coco("in.json", dataset_root="."), "out.json")
with open("out.json", encoding="utf-8") as file:
    made = json.load(file)["annotations"][0]
seen = made["keypoints"][2::3]
print(f"sleap-io {sleap_io.__version__}: visibility 2, 1, 0, 2 is {seen}, box {made['bbox']}, area {made['area']}")
box_kept = made["bbox"] == person["bbox"]
if not (seen == [2, 2, 0, 2] and not box_kept and made["area"] != 8000 and "segmentation" not in made):
    raise SystemExit("the behaviour has changed")
PYTHON
