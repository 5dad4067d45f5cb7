#!/bin/sh
# A binary PLY with the colours of most scans, red, green and blue as uchar, is read and written again.
# Guessed: colours are 0 to 255.
# Measured on 2026-11-27 with meshio 5.3.5: they are int8, so 200 is -56, and 255 is -1; the file that it writes has
# them as char. Other properties, such as an int and a float, stay.
# Readers guessed: right, right, wrong.
. "$(dirname "$0")/common.sh"
install meshio==5.3.5 plyfile==1.1.5 numpy==2.4.6
python - <<'PYTHON'
import meshio
import numpy as np
from plyfile import PlyData, PlyElement

FIELDS = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("object", "i4")]
points = np.zeros(3, dtype=FIELDS)
points["x"] = np.arange(3)
points["red"] = [100, 200, 255]
points["object"] = [-1, 0, 1]
faces = np.array([([0, 1, 2],)], dtype=[("vertex_indices", "i4", (3,))])
PlyData([PlyElement.describe(points, "vertex"), PlyElement.describe(faces, "face")]).write("scan.ply")

mesh = meshio.read("scan.ply")
mesh.write("copy.ply")
red = mesh.point_data["red"].tolist()
labels = mesh.point_data["object"].tolist()
copied = PlyData.read("copy.ply")["vertex"].data["red"].dtype
print(f"meshio {meshio.__version__}: red 100, 200, 255 is read as {red}, written as {copied}; labels {labels}")
if not (red == [100, -56, -1] and copied == np.int8 and labels == [-1, 0, 1]):
    raise SystemExit("the behaviour has changed")
PYTHON
