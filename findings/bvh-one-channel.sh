#!/bin/sh
# The knee of a BVH file has one channel, "CHANNELS 1 Xrotation", as hinges have, and is bent by 90 degrees.
# Guessed: readers bend it, or refuse the file.
# Measured on 2026-11-28: bvhio 1.5.4 bends it, pybvh 0.9.0 refuses the file, and bvhtools 1.6.0 leaves the leg
# straight, in silence: the foot is 14 cm beside its place for a shank of 10 cm.
# Readers guessed: in part, wrong, in part.
. "$(dirname "$0")/common.sh"
install bvhio==1.5.4 pyglm==2.8.2 spatial-transform==1.3.3 \
    bvhtools==1.6.0 pybvh==0.9.0 numpy==2.4.6
python - <<'PYTHON'
import bvhio
import pybvh
from bvhTools.bvhIO import readBvh

THREE = "CHANNELS 3 Zrotation Xrotation Yrotation"
with open("leg.bvh", "w", encoding="utf-8") as file:
    file.write(
        "HIERARCHY\nROOT Hip\n{\n\tOFFSET 0 0 0\n"
        "\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
        "\tJOINT Knee\n\t{\n\t\tOFFSET 0 -10 0\n\t\tCHANNELS 1 Xrotation\n"
        f"\t\tJOINT Foot\n\t\t{{\n\t\t\tOFFSET 0 -10 0\n\t\t\t{THREE}\n"
        "\t\t\tEnd Site\n\t\t\t{\n\t\t\t\tOFFSET 0 -5 0\n\t\t\t}\n\t\t}\n\t}\n}\n"
        "MOTION\nFrames: 1\nFrame Time: 0.04\n0 50 0 0 0 0 90 0 0 0\n"
    )
hierarchy = bvhio.readAsHierarchy("leg.bvh")
hierarchy.loadPose(0)
places = {joint.Name: joint.PositionWorld for joint, _, _ in hierarchy.layout()}
first = [round(float(value), 3) for value in places["Foot"]]
second = [round(float(value), 3) for value in readBvh("leg.bvh").getFKAtFrame(0)["Foot"][1]]
try:
    pybvh.read_bvh_file("leg.bvh")
    refused = False
except ValueError:
    refused = True
print(f"the foot is at {first} in bvhio, {second} in bvhtools; pybvh refuses the file: {refused}")
if not (first == [0, 40, -10] and second == [0, 30, 0] and refused):
    raise SystemExit("the behaviour has changed")
PYTHON
