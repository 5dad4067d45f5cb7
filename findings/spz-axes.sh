#!/bin/sh
# A PLY of splats, in which y is down, has one at x, y, z = .5, 1, 2. Two libraries make an SPZ of it, whose format
# has y up and z back, and PlayCanvas' splat-transform, which obeys that, reads both.
# Guessed: the splat is at .5, 1, 2 again.
# Measured on 2026-11-29 with gsply 0.4.6, gaussforge 0.6.0 and @playcanvas/splat-transform 2.7.1: it is at .5, -1,
# -2, in silence: the scene is upside down, and behind the camera. Both libraries store the numbers of the PLY as they
# are, and read their own files alike.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install gsply==0.4.6 gaussforge==0.6.0 numpy==2.4.6
install_npm @playcanvas/splat-transform@2.7.1
python -W ignore - <<'PYTHON'
import importlib.metadata
import subprocess
from pathlib import Path

import gaussforge
import gsply
import numpy as np

PLACE = np.array([[0.5, 1.0, 2.0]], np.float32)
zeros, turn = np.zeros((1, 3), np.float32), np.array([[1, 0, 0, 0]], np.float32)
gsply.plywrite("splat.ply", PLACE, zeros - 3, turn, np.zeros(1, np.float32), zeros)
gsply.write_spz("gsply.spz", gsply.plyread("splat.ply"), version=3)
made = gaussforge.GaussForge().convert(Path("splat.ply").read_bytes(), "ply", "spz")
Path("gaussforge.spz").write_bytes(made["data"])


def place(path):
    subprocess.run(["npx", "splat-transform", "-w", path, "out.csv"], check=True, capture_output=True)
    header, row = (line.split(",") for line in Path("out.csv").read_text().splitlines()[:2])
    values = dict(zip(header, row, strict=True))
    return [round(float(values[axis]), 3) for axis in "xyz"]


found = {path: place(path) for path in ("splat.ply", "gsply.spz", "gaussforge.spz")}
versions = {name: importlib.metadata.version(name) for name in ("gsply", "gaussforge")}
own = gsply.read_spz("gsply.spz").means.round(3).tolist()
print(f"{versions}: splat-transform has {found}, gsply {own}")
right, turned = [0.5, 1.0, 2.0], [0.5, -1.0, -2.0]
if not (found == {"splat.ply": right, "gsply.spz": turned, "gaussforge.spz": turned} and own == [right]):
    raise SystemExit("the behaviour has changed")
PYTHON
