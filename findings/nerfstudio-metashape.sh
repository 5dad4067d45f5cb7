#!/bin/sh
# A camera file of Metashape (XML) has two calibrations of a lens: "initial", as read from the photo, and "adjusted",
# as found by its alignment, with tangential distortion P1 and P2. nerfstudio makes its transforms.json of it.
# Guessed: the adjusted one, with p1 and p2 as Metashape has them.
# Measured on 2026-11-29 with nerfstudio 1.1.5: the initial one, in silence, since it takes the first: a focal length
# of 1000 px in place of 1100. Where the adjusted one stands alone, p1 and p2 keep their names, but P1 of Metashape is
# p2 of OpenCV, whose model nerfstudio has: a corner of the picture is 2.9 px off.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install numpy==2.4.6 opencv-python-headless==5.0.0.93 rich==14.3.3 imageio==2.38.1 rawpy==0.27.0 requests==2.34.2
install --no-deps nerfstudio==1.1.5
python -W ignore - <<'PYTHON'
import json
import sys
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np

sys.modules["open3d"] = ModuleType("open3d")  # The converter imports it for point clouds, of which there is none.
from nerfstudio.process_data.metashape_utils import metashape_to_json

SIZE = '<resolution width="1920" height="1080"/>'
CALIBRATION = f'<calibration type="frame" class="{{}}">{SIZE}<f>{{}}</f>{{}}</calibration>'
P1, P2 = 0.001, -0.0005
INITIAL = CALIBRATION.format("initial", 1000, "")
ADJUSTED = CALIBRATION.format("adjusted", 1100, f"<p1>{P1}</p1><p2>{P2}</p2>")
POSE = " ".join(map(str, np.eye(4).ravel()))


def converted(calibrations):
    Path("cameras.xml").write_text(
        '<document version="2.0.0"><chunk label="one" enabled="true"><sensors next_id="1">'
        f'<sensor id="0" label="lens" type="frame">{SIZE}{calibrations}</sensor></sensors>'
        '<cameras next_id="1" next_group_id="0"><camera id="0" sensor_id="0" label="photo">'
        f"<transform>{POSE}</transform></camera></cameras></chunk></document>"
    )
    metashape_to_json({"photo": Path("photo.jpg")}, Path("cameras.xml"), Path("."))
    return json.loads(Path("transforms.json").read_text())["frames"][0]


both, alone = converted(INITIAL + ADJUSTED), converted(ADJUSTED)
x, y = -960 / 1100, -540 / 1100
square = x * x + y * y
place = [x + P1 * (square + 2 * x * x) + 2 * P2 * x * y, y + P2 * (square + 2 * y * y) + 2 * P1 * x * y]
right = 1100 * np.array(place) + (960, 540)
matrix = np.array([[alone["fl_x"], 0, alone["cx"]], [0, alone["fl_y"], alone["cy"]], [0, 0, 1]])
factors = np.array([alone[name] for name in ("k1", "k2", "p1", "p2", "k3")])
found = cv2.projectPoints(np.array([[x, y, 1]]), np.zeros(3), np.zeros(3), matrix, factors)[0].ravel()
off = float(np.linalg.norm(found - right))
print(f"nerfstudio {version('nerfstudio')}: focal length {both['fl_x']} px of 1100; a corner is {off:.1f} px off")
if (both["fl_x"], alone["fl_x"], alone["p1"], alone["p2"]) != (1000, 1100, P1, P2) or off < 1:
    raise SystemExit("the behaviour has changed")
PYTHON
