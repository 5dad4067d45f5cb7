#!/bin/sh
# An AMC file of three frames, with its ASF skeleton, as those of the motion library of CMU: the root moves to x = 1,
# 2 and 3.
# Guessed: three poses.
# Measured on 2026-11-29 with pyacclaim 0.0.1: two; the last is left out, in silence. Of a file with one pose nothing
# is left.
# Readers guessed: right, right, wrong.
. "$(dirname "$0")/common.sh"
install pyacclaim==0.0.1 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata
from pathlib import Path

from pyacclaim import parser

Path("person.asf").write_text(
    ":version 1.10\n:name person\n:units\n  mass 1.0\n  length 1.0\n  angle deg\n"
    ":root\n  order TX TY TZ RX RY RZ\n  axis XYZ\n  position 0 0 0\n  orientation 0 0 0\n"
    ":bonedata\n  begin\n    id 1\n    name thigh\n    direction 0 -1 0\n    length 0.4\n    axis 0 0 0 XYZ\n"
    "    dof rx\n    limits (-160 20)\n  end\n:hierarchy\n  begin\n    root thigh\n  end\n"
)


def places(frames):
    poses = "".join(f"{number}\nroot {number} 0 0 0 0 0\nthigh {10 * number}\n" for number in range(1, frames + 1))
    Path("walk.amc").write_text(":FULLY-SPECIFIED\n:DEGREES\n" + poses)
    return [float(pose["root"][0]) for pose in parser.loadAMC(skeleton, "walk.amc")]


skeleton = parser.loadASF("person.asf", verbose=False)
found = {frames: places(frames) for frames in (3, 1)}
print(f"pyacclaim {importlib.metadata.version('pyacclaim')}: x of the root by number of frames: {found}")
if found != {3: [1.0, 2.0], 1: []}:
    raise SystemExit("the behaviour has changed")
PYTHON
