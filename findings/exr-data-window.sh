#!/bin/sh
# A renderer writes the depth of a region: an EXR of 8 x 6 px (display window) holds 4 x 3 px (data window), which
# begin at column 2 and row 1.
# Guessed: OpenCV and OpenImageIO return 8 x 6 px, since both read pictures for display; loaders of textures return 4
# x 3.
# Measured on 2026-11-29 with opencv-python-headless 4.14.0.94, openimageio 3.2.2.0, mitsuba 3.9.1 and three 0.187.0:
# all return 4 x 3 px from the first row and column on, without a word, so each pixel is another one in the photo.
# Only OpenImageIO keeps the offset, beside the pixels (`roi`).
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install OpenEXR==3.5.3 opencv-python-headless==4.14.0.94 openimageio==3.2.2.0 mitsuba==3.9.1 numpy==2.4.6
install_npm three@0.187.0
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";
import { FloatType } from "three";
import { EXRLoader } from "three/examples/jsm/loaders/EXRLoader.js";

const { buffer } = new Uint8Array(readFileSync("depth.exr"));
const { width, height } = new EXRLoader().setDataType(FloatType).parse(buffer);
console.log(JSON.stringify([height, width]));
NODE
OPENCV_IO_ENABLE_OPENEXR=1 python -W ignore - <<'PYTHON'
import json
import subprocess
from importlib.metadata import version

import cv2
import mitsuba
import numpy as np
import OpenEXR
import OpenImageIO

depth = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
header = {
    "compression": OpenEXR.ZIP_COMPRESSION,
    "type": OpenEXR.scanlineimage,
    "dataWindow": (np.array([2, 1], np.int32), np.array([5, 3], np.int32)),
    "displayWindow": (np.array([0, 0], np.int32), np.array([7, 5], np.int32)),
}
OpenEXR.File(header, {"Y": depth}).write("depth.exr")
mitsuba.set_variant("scalar_rgb")
picture = OpenImageIO.ImageBuf("depth.exr")
found = {
    "opencv": cv2.imread("depth.exr", cv2.IMREAD_UNCHANGED).shape[:2],
    "openimageio": picture.get_pixels(OpenImageIO.FLOAT).shape[:2],
    "mitsuba": np.array(mitsuba.Bitmap("depth.exr")).shape[:2],
    "three.js": json.loads(subprocess.run(["node", "look.mjs"], capture_output=True, check=True).stdout),
}
found = {name: list(shape) for name, shape in found.items()}
corner = picture.roi.xbegin, picture.roi.ybegin
print(f"opencv {cv2.__version__}, openimageio {version('openimageio')}: {found} px of 6 x 8, roi from {corner}")
if set(map(tuple, found.values())) != {(3, 4)} or corner != (2, 1):
    raise SystemExit("the behaviour has changed")
PYTHON
