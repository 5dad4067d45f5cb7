#!/bin/sh
# A C3D of 100 frames per second was trimmed: its header says that it begins with frame 101, so 1 s after the
# recording began. Two libraries of biomechanics read it.
# Guessed: both have times from 1.00 s, by the header; or both from 0.
# Measured on 2026-11-29 with kineticstoolkit 0.17.0, pyomeca 2026.0.2 and ezc3d 1.7.2: kineticstoolkit has 1.00 s,
# pyomeca 0 s, for the same frame, in silence, though both read the file with ezc3d.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install ezc3d==1.7.2 kineticstoolkit==0.17.0 pyomeca==2026.0.2 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version

import ezc3d
import kineticstoolkit
import numpy as np
import pyomeca

points = np.ones((4, 1, 8))
points[0, 0] = np.arange(8) / 10
file = ezc3d.c3d()
file["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
file["parameters"]["POINT"]["LABELS"]["value"] = ["head"]
file["header"]["points"]["first_frame"] = 100  # Counted from 0; the file counts from 1.
file["header"]["points"]["last_frame"] = 107
file["data"]["points"] = points
file.write("trimmed.c3d")
first = ezc3d.c3d("trimmed.c3d")["header"]["points"]["first_frame"] + 1
one = kineticstoolkit.read_c3d("trimmed.c3d")["Points"].time[0]
other = pyomeca.Markers.from_c3d("trimmed.c3d").time.values[0]
names = [f"{name} {version(name)}" for name in ("kineticstoolkit", "pyomeca")]
print(f"frame {first} is the first; {names[0]}: at {one:.2f} s; {names[1]}: at {other:.2f} s")
if (first, round(float(one), 2), float(other)) != (101, 1.0, 0.0):
    raise SystemExit("the behaviour has changed")
PYTHON
