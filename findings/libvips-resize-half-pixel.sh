#!/bin/sh
# libvips makes a ramp of 20 px, whose values are their columns, larger and smaller, "linear".
# Guessed: the middle of the picture stays the middle, as in OpenCV, so the values agree with it away from the border.
# Measured on 2026-11-29 with pyvips 3.2.0 and libvips 8.18.7: so they do for smaller pictures. A larger one is
# shifted by half of its own pixels to the right and down, which is .25 px of the first picture at twice the size, and
# .33 px at 1.5 times.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install pyvips==3.2.0 pyvips-binary==8.18.7 \
    opencv-python-headless==5.0.0.93 numpy==2.4.6
python - <<'PYTHON'
import cv2
import numpy as np
import pyvips

RAMP = np.tile(np.arange(20, dtype=np.float32), (20, 1))
image = pyvips.Image.new_from_array(RAMP)
found = {}
for scale in (2, 1.5, 0.5):
    row = image.resize(scale, kernel="linear").numpy()
    row = row[len(row) // 2]
    size = (len(row), len(row))
    flag = cv2.INTER_LINEAR if scale > 1 else cv2.INTER_AREA
    other = cv2.resize(RAMP, size, interpolation=flag)[0]
    inner = slice(len(row) // 4, -(len(row) // 4))
    found[scale] = round(float((row - other)[inner].mean()), 3) + 0.0
version = ".".join(str(pyvips.version(part)) for part in range(3))
print(f"pyvips {pyvips.__version__}, libvips {version}: px of the first picture beside OpenCV, by scale: {found}")
if found != {2: -0.25, 1.5: -0.333, 0.5: 0.0}:
    raise SystemExit("the behaviour has changed")
PYTHON
