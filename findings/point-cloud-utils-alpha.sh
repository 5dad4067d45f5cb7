#!/bin/sh
# A PLY file with red, green and blue, and no alpha, is read three times.
# Guessed: alpha is 255, or there is none.
# Measured on 2026-11-27 with point-cloud-utils 0.34.0: colours have four columns, and alpha is whatever the memory
# held.
# Readers guessed: in part, right, in part.
. "$(dirname "$0")/common.sh"
install point-cloud-utils==0.34.0 plyfile==1.1.5 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import point_cloud_utils
from plyfile import PlyData, PlyElement

points = np.zeros(64, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
points["x"] = np.arange(64)
points["red"] = 200
PlyData([PlyElement.describe(points, "vertex")]).write("points.ply")
alphas = []
for _ in range(3):
    scribble = np.full(4096, 63, dtype=np.uint8)
    del scribble
    colours = point_cloud_utils.load_triangle_mesh("points.ply").vertex_data.colors
    alphas.append(colours[:, 3].copy())
version = importlib.metadata.version("point-cloud-utils")
values = sorted({int(value) for alpha in alphas for value in alpha})
print(f"point-cloud-utils {version}: {colours.shape[1]} columns, alpha takes the values {values}")
if not (colours.shape[1] == 4 and colours[:, 0].min() == 200 and values != [255]):
    raise SystemExit("the behaviour has changed")
PYTHON
