#!/bin/sh
# An EXR of a renderer states which person a pixel shows by a whole number of 32 bits (UINT), here 16,777,217 and
# 3,000,000,000, as hashes of names are.
# Guessed: a reader that is asked for floats returns these numbers, rounded to float32, or refuses.
# Measured on 2026-11-29 with openimageio 3.2.2.0 and opencv-python-headless 4.14.0.94: OpenImageIO divides by 2^32,
# so the numbers are .0039 and .698, and a small number of people is 0, nearly; asked for UINT32, it keeps them.
# OpenCV rounds 16,777,217 to 16,777,216, the neighbour's number. Neither says so.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install OpenEXR==3.5.3 opencv-python-headless==4.14.0.94 openimageio==3.2.2.0 numpy==2.4.6
OPENCV_IO_ENABLE_OPENEXR=1 python - <<'PYTHON'
from importlib.metadata import version

import cv2
import numpy as np
import OpenEXR
import OpenImageIO

people = np.array([[16_777_217, 3_000_000_000]], np.uint32)
header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
OpenEXR.File(header, {"Y": people}).write("people.exr")
picture = OpenImageIO.ImageBuf("people.exr")
floats, whole = (picture.get_pixels(kind).ravel().tolist() for kind in (OpenImageIO.FLOAT, OpenImageIO.UINT32))
other = cv2.imread("people.exr", cv2.IMREAD_UNCHANGED).ravel().tolist()
print(f"openimageio {version('openimageio')}: {floats} as floats, {whole} as UINT32; opencv {cv2.__version__}: {other}")
shares = people.ravel() / (2**32 - 1)
if not (np.allclose(floats, shares, rtol=1e-6) and whole == people.ravel().tolist() and other == [16_777_216, 3e9]):
    raise SystemExit("the behaviour has changed")
PYTHON
