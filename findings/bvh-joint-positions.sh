#!/bin/sh
# A BVH whose inner joint has channels of position too, as many capture programs write for each joint: the OFFSET of
# the knee is -10, its Yposition -13.
# Guessed: readers put the knee 13 below the hip, since a position replaces the OFFSET.
# Measured on 2026-11-27: bvhio 1.5.4 does; bvh-converter 1.0.2 puts it 10 below in silence, bvhtools 1.6.0 with a
# warning, and pybvh 0.9.0 refuses the file.
# Readers guessed: in part, wrong, in part.
. "$(dirname "$0")/common.sh"
install bvhio==1.5.4 pyglm==2.8.2 spatial-transform==1.3.3 bvh-converter==1.0.2 bvhtools==1.6.0 \
    pybvh==0.9.0 numpy==2.4.6
python - <<'PYTHON'
import csv
import os
import subprocess
import sys

import bvhio
import pybvh
from bvhTools.bvhIO import readBvh

SIX = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
with open("leg.bvh", "w", encoding="utf-8") as file:
    file.write(
        f"HIERARCHY\nROOT Hip\n{{\n\tOFFSET 0 0 0\n\t{SIX}\n"
        f"\tJOINT Knee\n\t{{\n\t\tOFFSET 0 -10 0\n\t\t{SIX}\n"
        "\t\tEnd Site\n\t\t{\n\t\t\tOFFSET 0 -5 0\n\t\t}\n\t}\n}\n"
        "MOTION\nFrames: 1\nFrame Time: 0.04\n0 50 0 0 0 0 0 -13 0 0 0 0\n"
    )
hierarchy = bvhio.readAsHierarchy("leg.bvh")
hierarchy.loadPose(0)
below = {"bvhio": 50 - [joint for joint, _, _ in hierarchy.layout() if joint.Name == "Knee"][0].PositionWorld[1]}
command = os.path.join(os.path.dirname(sys.executable), "bvh-converter")
subprocess.run([command, "leg.bvh"], check=True, stdout=subprocess.DEVNULL)
with open("leg_worldpos.csv", encoding="utf-8") as file:
    below["bvh-converter"] = 50 - float(next(csv.DictReader(file))["Knee.Y"])
below["bvhtools"] = 50 - float(readBvh("leg.bvh").getFKAtFrame(0)["Knee"][1][1])
try:
    pybvh.read_bvh_file("leg.bvh")
    refused = False
except ValueError:
    refused = True
print(f"the knee is below the hip by {below}; pybvh refuses the file: {refused}")
wanted = {"bvhio": 13, "bvh-converter": 10, "bvhtools": 10}
if not (refused and all(abs(below[name] - value) < 1e-4 for name, value in wanted.items())):
    raise SystemExit("the behaviour has changed")
PYTHON
