#!/bin/sh
# A TRC file of two markers; in the second frame the first, the head, was not seen, so its three cells are empty, as
# the format has it.
# Guessed: readers have no head there, or NaN, and the foot in its place.
# Measured on 2026-11-29 with trc-data-reader 0.4.1 and nimblephysics 0.10.52.1: both read cells between spaces, so
# the head has the place of the foot, and the foot is missing, in silence. trc-data-reader writes such files itself.
# nimblephysics states 150 frames per second for three frames of 100, too.
# Readers guessed: in part, in part, wrong.
. "$(dirname "$0")/common.sh"
install trc-data-reader==0.4.1 c3d==0.6.0 numpy==2.4.6
install --no-deps nimblephysics==0.10.52.1
python -W ignore - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import numpy as np
import trc
from nimblephysics_libs import _nimblephysics  # the package itself imports torch, too

HEAD, FOOT = [0.0, 1.7, 0.2], [0.0, 0.1, 0.2]
LINES = [
    "PathFileType\t4\t(X/Y/Z)\tjoints.trc",
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
    "100.00\t100.00\t3\t2\tm\t100.00\t1\t3",
    "Frame#\tTime\thead\t\t\tfoot\t\t",
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
    "",
]
for number in range(3):
    seen = ["", "", ""] if number == 1 else HEAD
    LINES.append("\t".join(map(str, [number + 1, number / 100, *seen, *FOOT])))
Path("joints.trc").write_text("\n".join(LINES) + "\n")

data = trc.TRCData()
data.load("joints.trc")
plain = {name: np.round(data[name][1], 3).tolist() for name in ("head", "foot")}
read = _nimblephysics.biomechanics.OpenSimParser.loadTRC(str(Path("joints.trc").resolve()))
nimble = {name: np.round(place, 3).tolist() for name, place in read.markerTimesteps[1].items()}
data["head"], data["foot"] = [HEAD, [float("nan")] * 3, HEAD], [FOOT] * 3
for number in range(3):
    data[number + 1] = (number / 100, [data["head"][number], data["foot"][number]])
data.save("written.trc")
again = trc.TRCData()
again.load("written.trc")
versions = [f"{name} {importlib.metadata.version(name)}" for name in ("trc-data-reader", "nimblephysics")]
print(f"{versions[0]}: {plain}, its own file {again['head'][1]}; {versions[1]}: {nimble}, {read.framesPerSecond} Hz")
shifted = plain["head"] == FOOT and np.isnan(plain["foot"]).all() and again["head"][1] == FOOT
if not (shifted and nimble == {"head": FOOT} and read.framesPerSecond == 150):
    raise SystemExit("the behaviour has changed")
PYTHON
