#!/bin/sh
# A grey TIFF states that 0 is white (WhiteIsZero), as scanners and masks do; one has 8 bits, the other 16.
# Guessed: Pillow and OpenCV turn both around, and tifffile returns what is stored.
# Measured on 2026-11-28 with Pillow 13.0.0 and OpenCV 5.0.0: they turn 8 bits around, and leave 16 bits as stored, so
# the same picture is a negative in one of both. tifffile 2026.3.3 turns none around.
. "$(dirname "$0")/common.sh"
install pillow==13.0.0 opencv-python-headless==5.0.0.93 \
    tifffile==2026.3.3 numpy==2.4.6
python - <<'PYTHON'
import cv2
import numpy as np
import PIL
import tifffile
from PIL import Image

found = {}
for kind in (np.uint8, np.uint16):
    stored = np.array([[0, 100]], kind)
    tifffile.imwrite("white.tif", stored, photometric="miniswhite")
    with Image.open("white.tif") as image:
        pillow = np.array(image)
    opencv = cv2.imread("white.tif", cv2.IMREAD_UNCHANGED)
    read = {"Pillow": pillow, "OpenCV": opencv, "tifffile": tifffile.imread("white.tif")}
    found[np.dtype(kind).name] = {name: values.ravel().tolist() for name, values in read.items()}
versions = (PIL.__version__, cv2.__version__, tifffile.__version__)
print(f"Pillow, OpenCV, tifffile {versions}: stored [0, 100], read {found}")
turned = {"Pillow": [255, 155], "OpenCV": [255, 155], "tifffile": [0, 100]}
if found != {"uint8": turned, "uint16": dict.fromkeys(turned, [0, 100])}:
    raise SystemExit("the behaviour has changed")
PYTHON
