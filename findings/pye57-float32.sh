#!/bin/sh
# An E57 scan is written from float64 coordinates, as of a map projection.
# Guessed: they are stored as float64.
# Measured on 2026-11-27 with pye57 0.4.19: they are stored as float32, so 6,378,137.123456 m comes back .123 m
# smaller. Colours from 0 to 1 are truncated to bytes of 0 and 1. One unknown point (NaN) makes the file fail when it
# is closed.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install pye57==0.4.19 numpy==2.4.6
python - <<'PYTHON'
import gc
import importlib.metadata

import numpy as np
import pye57

version = importlib.metadata.version("pye57")
axes = ("cartesianX", "cartesianY", "cartesianZ")
colours = ("colorRed", "colorGreen", "colorBlue")


def written(values, colour):
    file = pye57.E57("scan.e57", mode="w")
    file.write_scan_raw({axis: values for axis in axes} | {name: colour for name in colours})
    file.close()
    return pye57.E57("scan.e57").read_scan_raw(0)


metres = np.array([1.5, 6378137.123456])
read = written(metres, np.array([1.0, 0.5], dtype=np.float32))
error = np.abs(read["cartesianX"] - metres).max()
reds = read["colorRed"].tolist()
refused = False
try:
    written(np.array([1.5, np.nan]), np.array([255, 0]))
except IndexError as failure:
    refused = True
    print("NaN:", type(failure).__name__)
gc.collect()
print(f"pye57 {version}: largest error {error:.3f} m, colours 1 and .5 come back as {reds}, NaN refused: {refused}")
if not (error > 0.1 and reds == [1, 0] and refused):
    raise SystemExit("the behaviour has changed")
PYTHON
