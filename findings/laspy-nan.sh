#!/bin/sh
# A point cloud with one unknown depth (NaN) is written as LAS.
# Guessed: an error, as for a value that does not fit.
# Measured on 2026-11-27 with laspy 2.7.0: the point is stored at -21474836.48 m, and the bounds of the cloud follow
# it. A default header rounds all coordinates to 1 cm.
. "$(dirname "$0")/common.sh"
install laspy==2.7.0 numpy==2.4.6
python - <<'PYTHON'
import warnings

warnings.simplefilter("ignore")

import laspy
import numpy as np

cloud = laspy.create(point_format=3, file_version="1.4")
cloud.x = np.array([1.23456, np.nan])
cloud.y = np.zeros(2)
cloud.z = np.ones(2)
cloud.write("cloud.las")
read = laspy.read("cloud.las")
x = np.array(read.x)
refused = False
try:
    cloud.x = np.array([1e9, 0.0])
except OverflowError:
    refused = True
print(f"laspy {laspy.__version__}: x = {x.tolist()}, smallest x of the header {read.header.mins[0]}, 1e9 refused: {refused}")
if not (abs(x[0] - 1.23) < 1e-9 and x[1] < -2e7 and read.header.mins[0] < -2e7 and refused):
    raise SystemExit("the behaviour has changed")
PYTHON
