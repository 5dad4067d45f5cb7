#!/bin/sh
# MeshLab opens a PLY whose vertices have a uchar property "contact", an int "object" and a float "quality", and saves
# it.
# Guessed: own properties of integers arrive as attributes of vertices, as floats of other names do.
# Measured on 2026-11-27 with pymeshlab 2025.7.post1: only "quality" (float) is kept; the others are gone without a
# word.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install pymeshlab==2025.7.post1
cat > "$folder/in.ply" <<'PLY'
ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property uchar contact
property int object
property float quality
element face 1
property list uchar int vertex_indices
end_header
0 0 0 1 7 0.25
1 0 0 1 7 0.5
0 1 0 0 7 0.75
3 0 1 2
PLY
python - "$folder" <<'PYTHON'
import sys
from importlib.metadata import version
from pathlib import Path

import pymeshlab

folder = Path(sys.argv[1])
meshes = pymeshlab.MeshSet()
meshes.load_new_mesh(str(folder / "in.ply"))
mesh = meshes.current_mesh()
quality = mesh.vertex_scalar_array().tolist()
meshes.save_current_mesh(str(folder / "out.ply"), binary=False)
header = (folder / "out.ply").read_text().split("end_header")[0]
kept = [name for name in ("contact", "object", "quality") if f" {name}\n" in header]
print(f"pymeshlab {version('pymeshlab')}: quality {quality}, kept in the saved file: {kept}")
if quality != [0.25, 0.5, 0.75] or kept != ["quality"]:
    raise SystemExit("the behaviour has changed")
PYTHON
