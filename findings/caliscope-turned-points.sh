#!/bin/sh
# Caliscope's trackers of people turn the frames of a camera with `rotation_count`, find points in them, and turn the
# points back.
# Guessed: the index of a pixel comes back as it was.
# Measured on 2026-11-27 with caliscope 0.11.8: it comes back 1 px off in one axis after one or three quarter turns,
# and in both after two.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install numpy==2.4.6 opencv-python-headless==5.0.0.93
install --no-deps caliscope==0.11.8
python - "$folder/venv" <<'PYTHON'
import importlib.util
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

# The file alone: the package around it needs a window system.
file = next(Path(sys.argv[1]).glob("lib/python*/site-packages/caliscope/trackers/helper.py"))
spec = importlib.util.spec_from_file_location("helper", file)
helper = importlib.util.module_from_spec(spec)
spec.loader.exec_module(helper)

frame = np.zeros((48, 64), np.uint8)
frame[20, 10] = 255
found = {}
for turns in (0, 1, 2, 3):
    turned = helper.apply_rotation(frame, turns)
    height, width = turned.shape
    y, x = np.argwhere(turned)[0]
    back = helper.unrotate_points(np.array([[x, y]], np.float64), turns, width, height)
    found[turns] = back[0].tolist()
print(f"caliscope {version('caliscope')}: the point (10, 20) comes back at {found}")
if found != {0: [10, 20], 1: [10, 21], 2: [11, 21], 3: [11, 20]}:
    raise SystemExit("the behaviour has changed")
PYTHON
