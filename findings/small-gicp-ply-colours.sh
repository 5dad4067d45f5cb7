#!/bin/sh
# small_gicp, which aligns scans, reads a binary PLY of points with colours.
# Guessed: the points, without the colours.
# Measured on 2026-11-27 with small-gicp 1.0.1: a cloud of 0 points and a line on standard error, without an
# exception, since it reads properties of type float alone. Without the colours it reads the points.
# Readers guessed: wrong, wrong, right.
. "$(dirname "$0")/common.sh"
install small-gicp==1.0.1 plyfile==1.1.5 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import small_gicp
from plyfile import PlyData, PlyElement

PLACE = [("x", "f4"), ("y", "f4"), ("z", "f4")]
COLOUR = [("red", "u1"), ("green", "u1"), ("blue", "u1")]


def points_read(fields):
    points = np.ones(5, dtype=fields)
    PlyData([PlyElement.describe(points, "vertex")]).write("scan.ply")
    return small_gicp.read_ply("scan.ply").size()


plain = points_read(PLACE)
coloured = points_read(PLACE + COLOUR)
version = importlib.metadata.version("small-gicp")
print(f"small-gicp {version}: {plain} of 5 points without colours, {coloured} with")
if (plain, coloured) != (5, 0):
    raise SystemExit("the behaviour has changed")
PYTHON
