#!/bin/sh
# Pose2Sim converts a C3D of 59.94 frames per second, in mm, to TRC: a marker is at 1700 mm in all of them.
# Guessed: the TRC has 1700 with the unit mm, or 1.7 with m, and the rate of the file.
# Measured on 2026-11-29 with pose2sim 0.10.49: 1.7 with the unit mm, so readers that obey the unit, as OpenSim does,
# see a person of 1.7 mm. The rate is cut to 59, and times with it: the last frame is at 10.17 s in place of 9.99 s.
# `trc_scale` leaves the unit as it was, too.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install c3d==0.6.0 ezc3d==1.7.2 pandas==3.1.1 numpy==2.4.6
install --no-deps pose2sim==0.10.49
python -W ignore - <<'PYTHON'
import importlib.metadata
import importlib.util
import sys
from pathlib import Path

import ezc3d
import numpy as np

RATE = 60000 / 1001
file = ezc3d.c3d()
for name, value in (("RATE", [RATE]), ("LABELS", ("head",)), ("UNITS", ["mm"])):
    file["parameters"]["POINT"][name]["value"] = value
file["data"]["points"] = np.full((4, 1, 600), 1700.0)
file.write("head.c3d")


def tool(name):
    """Load a converter by its file: the package itself imports networks that it does not need."""
    folder = next(Path(entry) / "Pose2Sim" for entry in sys.path if (Path(entry) / "Pose2Sim").is_dir())
    spec = importlib.util.spec_from_file_location(name, folder / "Utilities" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def stated(path):
    lines = Path(path).read_text().splitlines()
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    last = lines[-1].split("\t")
    return header["Units"], float(last[2]), header["DataRate"], round(float(last[1]), 2)


tool("c3d_to_trc").c3d_to_trc_func("head.c3d", "head.trc")
tool("trc_scale").trc_scale_func("head.trc", 1000, "scaled.trc")
converted, scaled = stated("head.trc"), stated("scaled.trc")
version = importlib.metadata.version("pose2sim")
print(f"pose2sim {version}: unit, height, rate, last time: {converted}; scaled by 1000: {scaled}; {599 / RATE:.2f} s")
if not (converted[:3] == ("mm", 1.7, "59") and converted[3] > 10.1 and scaled[:2] == ("mm", 1700.0)):
    raise SystemExit("the behaviour has changed")
PYTHON
