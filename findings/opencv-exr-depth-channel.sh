#!/bin/sh
# OpenCV reads the EXR depth that renderers write: one channel named Z.
# Guessed: its values, or an error.
# Measured on 2026-11-27 with opencv-python-headless 4.14.0.94: zeros, without a warning; of X, Y and Z it returns Y
# alone. The wheel 5.0.0.93 is built without EXR: it returns None, although OPENCV_IO_ENABLE_OPENEXR is set.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install OpenEXR==3.5.3 opencv-python-headless==4.14.0.94
export OPENCV_IO_ENABLE_OPENEXR=1
cat > "$folder/read.py" <<'PYTHON'
import sys

import cv2
import numpy as np
import OpenEXR

depth = np.full((8, 8), 3, np.float32)
header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
found = []
for channels in ({"Z": depth}, {"X": depth - 2, "Y": depth - 1, "Z": depth}):
    path = f"{sys.argv[1]}/{''.join(channels)}.exr"
    OpenEXR.File(header, channels).write(path)
    values = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    found.append(None if values is None else (values.shape, float(values.max())))
print(f"opencv {cv2.__version__}: Z alone {found[0]}, X, Y and Z {found[1]}")
expected = [None, None] if cv2.__version__.startswith("5") else [((8, 8), 0.0), ((8, 8), 2.0)]
if found != expected:
    raise SystemExit("the behaviour has changed")
PYTHON
python "$folder/read.py" "$folder"
install opencv-python-headless==5.0.0.93
python "$folder/read.py" "$folder"
