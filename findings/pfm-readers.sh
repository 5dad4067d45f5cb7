#!/bin/sh
# A PFM file of depth has a scale of -2, whose sign states the order of bytes, and its rows from below.
# Guessed: readers leave the size of the scale out, and put the first row on top.
# Measured on 2026-11-28: Pillow 13.0.0 does. OpenCV 5.0.0 divides by 2, OpenImageIO 3.2.2.0 multiplies by 2.
# OpenImageIO has the picture upside down, also for a scale of -1.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install pillow==13.0.0 opencv-python-headless==5.0.0.93 \
    openimageio==3.2.2.0 numpy==2.4.6
python - <<'PYTHON'
import cv2
import numpy as np
import OpenImageIO
from PIL import Image

DEPTH = np.array([[1.5, 2.5], [4.5, 5.5]], "<f4")


def first_of_rows(scale):
    """The first value of the upper and of the lower row, for each library."""
    with open("depth.pfm", "wb") as file:
        file.write(f"Pf\n2 2\n{scale}\n".encode() + DEPTH[::-1].tobytes())
    with Image.open("depth.pfm") as image:
        pillow = np.array(image)
    found = {
        "Pillow": pillow,
        "OpenCV": cv2.imread("depth.pfm", cv2.IMREAD_UNCHANGED),
        "OpenImageIO": OpenImageIO.ImageBuf("depth.pfm").get_pixels(OpenImageIO.FLOAT)[..., 0],
    }
    return {name: values[:, 0].tolist() for name, values in found.items()}


two = first_of_rows(-2.0)
one = first_of_rows(-1.0)
print(f"first values of the rows, [1.5, 4.5] in the file: scale -2 {two}; scale -1 {one}")
plain = [1.5, 4.5]
if not (
    two == {"Pillow": plain, "OpenCV": [0.75, 2.25], "OpenImageIO": [9, 3]}
    and one == {"Pillow": plain, "OpenCV": plain, "OpenImageIO": [4.5, 1.5]}
):
    raise SystemExit("the behaviour has changed")
PYTHON
