#!/bin/sh
# A C3D file is written by ezc3d with points, labels and rate alone, and read by two libraries of biomechanics.
# Guessed: the unit is millimetres where nobody states one, and both read the file.
# Measured on 2026-11-27: ezc3d 1.7.2 writes an empty POINT:UNITS. kineticstoolkit 0.17.0 and pyomeca 2026.0.2 both
# end with an IndexError. With the unit "m" both read the file.
# Readers guessed: right, right, in part.
. "$(dirname "$0")/common.sh"
install ezc3d==1.7.2 kineticstoolkit==0.17.0 pyomeca==2026.0.2 numpy==2.4.6
python - <<'PYTHON'
import warnings

warnings.simplefilter("ignore")

import ezc3d
import kineticstoolkit.lab as ktk
import numpy as np
import pyomeca


def write(units):
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100]
    file["parameters"]["POINT"]["LABELS"]["value"] = ("ankle",)
    if units:
        file["parameters"]["POINT"]["UNITS"]["value"] = [units]
    points = np.ones((4, 1, 2))
    points[:3, 0, 0] = [1.5, 2.5, 3.5]
    file["data"]["points"] = points
    file.write("joints.c3d")
    return ezc3d.c3d("joints.c3d")["parameters"]["POINT"]["UNITS"]["value"]


def outcome(read):
    try:
        return round(float(read()), 3)
    except IndexError as failure:
        return type(failure).__name__


def both():
    toolkit = outcome(lambda: ktk.read_c3d("joints.c3d")["Points"].data["ankle"][0, 0])
    omeca = outcome(lambda: pyomeca.Markers.from_c3d("joints.c3d").values[0, 0, 0])
    return toolkit, omeca


units = list(write(None))
silent = both()
write("m")
stated = both()
print(f"units written: {units}; kineticstoolkit, pyomeca without a unit: {silent}; with m: {stated}")
if not (units == [] and silent == ("IndexError", "IndexError") and stated == (1.5, 1.5)):
    raise SystemExit("the behaviour has changed")
PYTHON
