#!/bin/sh
# An OBJ file lists texture coordinates in another order than vertices, and its faces say which belongs to which (f
# 1/3 2/4 ...), as most exporters write it.
# Guessed: a reader obeys the faces, or leaves texture coordinates out.
# Measured on 2026-11-29 with meshio 5.3.5: it gives them to the vertices in the order of the file, so the picture
# lies elsewhere, in silence. Where their numbers differ, as at each seam of a texture, it refuses the file. trimesh
# 5.2.0 obeys the faces.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install meshio==5.3.5 trimesh==5.2.0 pillow==13.0.0 \
    numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import meshio
import numpy as np
import trimesh

square = [[0, 0], [1, 0], [1, 1], [0, 1]]
lines = [f"v {x} {y} 0" for x, y in square] + ["vt 1 1", "vt 0 1", "vt 0 0", "vt 1 0"]
faces = ["f 1/3 2/4 3/1", "f 1/3 3/1 4/2"]
with open("square.obj", "w", encoding="utf-8") as file:
    file.write("\n".join(lines + faces) + "\n")
with open("seam.obj", "w", encoding="utf-8") as file:
    file.write("\n".join([*lines, "vt 0.5 0.5", *faces]) + "\n")
found = meshio.read("square.obj").point_data["obj:vt"]
right = trimesh.load("square.obj", process=False, force="mesh").visual.uv
try:
    meshio.read("seam.obj")
    refused = False
except ValueError:
    refused = True
print(f"meshio {importlib.metadata.version('meshio')}: texture coordinates {found.tolist()}; by the faces {square}")
print(f"trimesh {importlib.metadata.version('trimesh')}: {right.tolist()}; meshio refuses a fifth: {refused}")
if not (np.array_equal(found, [[1, 1], [0, 1], [0, 0], [1, 0]]) and np.array_equal(right, square) and refused):
    raise SystemExit("the behaviour has changed")
PYTHON
