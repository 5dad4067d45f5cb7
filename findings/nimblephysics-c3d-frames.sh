#!/bin/sh
# Nimble, which AddBiomechanics is made with, loads a C3D of eight frames, whose marker moves by .1 m in each. Two
# libraries wrote it.
# Guessed: eight frames, from the first.
# Measured on 2026-11-29 with nimblephysics 0.10.52.1: six, of both files: the first two are left out, in silence, and
# times begin at 0 with the third, so videos and forces of the same take are 20 ms apart from it.
# Readers guessed: wrong, in part, wrong.
. "$(dirname "$0")/common.sh"
install ezc3d==1.7.2 c3d==0.6.0 numpy==2.4.6
install --no-deps nimblephysics==0.10.52.1
python -W ignore - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import c3d
import ezc3d
import numpy as np
from nimblephysics_libs import _nimblephysics as nimble  # the package itself imports torch, too

STEPS = 0.1 * np.arange(8)
file = ezc3d.c3d()
for name, value in (("RATE", [100]), ("LABELS", ("head",)), ("UNITS", ["m"])):
    file["parameters"]["POINT"][name]["value"] = value
points = np.ones((4, 1, 8))
points[0, 0] = STEPS
file["data"]["points"] = points
file.write("ezc3d.c3d")
writer = c3d.Writer(point_rate=100, analog_rate=0, point_units="m  ", gen_scale=-1.0)
writer.set_point_labels(["head"])
writer.add_frames([(np.array([[step, 1.0, 1.0, 0.0, 0.0]]), np.array([])) for step in STEPS])
with open("c3d.c3d", "wb") as stream:
    writer.write(stream)

seen = {}
for path in ("ezc3d.c3d", "c3d.c3d"):
    read = nimble.biomechanics.C3DLoader.loadC3D(str(Path(path).resolve()))
    places = [round(float(markers["head"][0]), 2) for markers in read.markerTimesteps]
    seen[path] = (places, round(read.timestamps[0], 3), len(ezc3d.c3d(path)["data"]["points"][0, 0]))
print(f"nimblephysics {importlib.metadata.version('nimblephysics')}: x, first time, frames of the file: {seen}")
if any(value != ([0.2, 0.3, 0.4, 0.5, 0.6, 0.7], 0.0, 8) for value in seen.values()):
    raise SystemExit("the behaviour has changed")
PYTHON
