#!/bin/sh
# A BVH file has two roots, as some programs write two people: one at x = 0, the other at x = 100.
# Guessed: readers read both, or refuse the file.
# Measured on 2026-11-28: pybvh 0.9.0 and bvhio 1.5.4 refuse it. bvhtools 1.6.0 returns the first person alone, in
# silence. bvhsdk 0.2.1 returns the second person alone, at the place of the first.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install bvhio==1.5.4 pyglm==2.8.2 spatial-transform==1.3.3 \
    bvhtools==1.6.0 bvhsdk==0.2.1 pybvh==0.9.0 numpy==2.4.6
python - <<'PYTHON'
import bvhio
import bvhsdk
import pybvh
from bvhTools.bvhIO import readBvh

ROOT = (
    "ROOT {}\n{{\n\tOFFSET 0 0 0\n\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
    "\tEnd Site\n\t{{\n\t\tOFFSET 0 -5 0\n\t}}\n}}\n"
)
with open("two.bvh", "w", encoding="utf-8") as file:
    file.write("HIERARCHY\n" + ROOT.format("First") + ROOT.format("Second"))
    file.write("MOTION\nFrames: 1\nFrame Time: 0.04\n0 50 0 0 0 0 100 50 0 0 0 0\n")
refused = []
for name, read in {"pybvh": pybvh.read_bvh_file, "bvhio": bvhio.readAsHierarchy}.items():
    try:
        read("two.bvh")
    except (ValueError, SyntaxError):
        refused.append(name)
places = readBvh("two.bvh").getFKAtFrame(0)
first = {name: round(float(place[1][0])) for name, place in places.items() if "Site" not in name}
second = {joint.name: round(float(joint.getPosition(0)[0])) for joint in bvhsdk.ReadFile("two.bvh").getlistofjoints()}
print(f"x of the people: bvhtools {first}, bvhsdk {second}; refused by {refused}")
if not (refused == ["pybvh", "bvhio"] and first == {"First": 0} and second == {"Second": 0}):
    raise SystemExit("the behaviour has changed")
PYTHON
