#!/bin/sh
# c3d's Writer stores three frames of a marker that moves along x; in the second it is missing (residual -1, NaN).
# Guessed: the file has NaN or zeros there.
# Measured on 2026-11-28 with c3d 0.6.0: it has the place of the frame before, with residual -1, in the unit mm
# whatever the numbers are. ezc3d 1.7.2 obeys the residual (NaN); c3d's own reader returns the old place, as does all
# that looks at coordinates alone.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install c3d==0.6.0 ezc3d==1.7.2 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata

import c3d
import ezc3d
import numpy as np

frames = []
for place in (1.0, 2.0, 3.0):
    marker = np.array([[place, 0.0, 0.0, 0.0, 0.0]], np.float32)
    frames.append((marker, np.zeros((0, 0))))
frames[1][0][0] = [np.nan, np.nan, np.nan, -1.0, -1.0]
writer = c3d.Writer(point_rate=30, analog_rate=0, point_scale=-1.0)
writer.set_point_labels(["knee"])
writer.add_frames(frames)
with open("made.c3d", "wb") as file:
    writer.write(file)
with open("made.c3d", "rb") as file:
    own = [points[0].tolist() for _, points, _ in c3d.Reader(file).read_frames()]
read = ezc3d.c3d("made.c3d")
other = read["data"]["points"][0, 0].tolist()
unit = read["parameters"]["POINT"]["UNITS"]["value"][0]
versions = [importlib.metadata.version(name) for name in ("c3d", "ezc3d")]
places = [(row[0], row[3]) for row in own]
print(f"c3d {versions[0]} reads x and residual {places}; ezc3d {versions[1]} reads x {other}, unit {unit}")
if not (places[1] == (1.0, -1.0) and other[1] != other[1] and other[2] == 3.0 and unit == "mm"):
    raise SystemExit("the behaviour has changed")
PYTHON
