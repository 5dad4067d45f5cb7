#!/bin/sh
# bvhio reads a BVH as a hierarchy, to edit it, and writes it again.
# Guessed: all offsets stay.
# Measured on 2026-11-27 with bvhio 1.5.4: the end of a chain is lost when the file is read, and another is made up
# when it is written, three tenths of the last bone: .06 m beyond a forearm of .2 m, where the file has .1 m. Reading
# and writing it as BVH alone keeps the end.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install bvhio==1.5.4 numpy==2.4.6 pyglm==2.8.2 spatial-transform==1.3.3
python - <<'PYTHON'
import importlib.metadata

import bvhio

MOTION = "MOTION\nFrames: 1\nFrame Time: 0.04\n0 1 0 0 0 0 0 0 0\n"
with open("arm.bvh", "w", encoding="utf-8") as file:
    file.write(
        "HIERARCHY\nROOT Elbow\n{\n\tOFFSET 0 0 0\n"
        "\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
        "\tJOINT Hand\n\t{\n\t\tOFFSET 0.2 0 0\n\t\tCHANNELS 3 Zrotation Xrotation Yrotation\n"
        "\t\tEnd Site\n\t\t{\n\t\t\tOFFSET 0.1 0 0\n\t\t}\n\t}\n}\n" + MOTION
    )


def end_of(path):
    with open(path, encoding="utf-8") as file:
        text = file.read()
    return float(text.split("End Site")[1].split("OFFSET")[1].split()[0])


bvhio.writeBvh("plain.bvh", bvhio.readAsBvh("arm.bvh"))
bvhio.writeHierarchy("hierarchy.bvh", bvhio.readAsHierarchy("arm.bvh"), 0.04)
plain = end_of("plain.bvh")
edited = end_of("hierarchy.bvh")
version = importlib.metadata.version("bvhio")
print(f"bvhio {version}: the end of the hand is at {plain:.3f} m as BVH, {edited:.3f} m as a hierarchy, 0.100 m in the file")
if not (abs(plain - 0.1) < 1e-6 and abs(edited - 0.06) < 1e-6):
    raise SystemExit("the behaviour has changed")
PYTHON
