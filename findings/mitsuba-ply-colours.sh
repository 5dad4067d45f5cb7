#!/bin/sh
# Mitsuba loads a PLY with colours as uchar, one vertex of which has the normal 0, 0, 0, as for unknown.
# Guessed: colours become 0 to 1, and the normal stays 0.
# Measured on 2026-11-28 with mitsuba 3.9.1: the attribute "vertex_color" is 0 to 255, with a warning, so as a texture
# (mesh_attribute) it reflects up to 255 times the light; the normal becomes NaN, without one.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install mitsuba==3.9.1 plyfile==1.1.5 numpy==2.4.6
python - <<'PYTHON'
import mitsuba
import numpy as np
from plyfile import PlyData, PlyElement

mitsuba.set_variant("scalar_rgb")
FIELDS = [(name, "f4") for name in ("x", "y", "z", "nx", "ny", "nz")] + [(name, "u1") for name in ("red", "green", "blue")]
points = np.zeros(3, dtype=FIELDS)
points["x"] = [0, 1, 0]
points["y"] = [0, 0, 1]
points["nz"] = [1, 1, 0]
points["red"] = 200
faces = np.array([([0, 1, 2],)], dtype=[("vertex_indices", "i4", (3,))])
PlyData([PlyElement.describe(points, "vertex"), PlyElement.describe(faces, "face")]).write("scan.ply")

mesh = mitsuba.traverse(mitsuba.load_dict({"type": "ply", "filename": "scan.ply"}))
red = float(np.array(mesh["vertex_color"]).reshape(-1, 3)[0, 0])
normals = np.array(mesh["vertex_normals"]).reshape(-1, 3)
print(f"mitsuba {mitsuba.__version__}: red 200 is {red}, normal 0, 0, 0 is {normals[2].tolist()}")
if not (red == 200.0 and np.isnan(normals[2]).all() and normals[0, 2] == 1):
    raise SystemExit("the behaviour has changed")
PYTHON
