#!/bin/sh
# numcodecs' FixedScaleOffset, a filter of Zarr, stores depths in metres as millimetres in 16 bits (scale 1000, u2).
# Guessed: 70 m, which does not fit, ends at 65.535 m, or is refused, and so is NaN.
# Measured on 2026-11-29 with numcodecs 0.16.6 on x86-64: 70 m comes back as 4.464 m, and -1 m as 64.536 m, without a
# warning: a wall far away is in front of the people. NaN comes back as 0 m; NumPy warns of it.
. "$(dirname "$0")/common.sh"
install numcodecs==0.16.6 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata
import warnings

import numcodecs
import numpy as np

codec = numcodecs.FixedScaleOffset(offset=0, scale=1000, dtype="f4", astype="u2")


def again(depths):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        return codec.decode(codec.encode(np.array(depths, np.float32))), len(caught)


found, warned = again([1.5, 65.5, 70, -1])
unknown, warned_of_nan = again([np.nan])
version = importlib.metadata.version("numcodecs")
print(f"numcodecs {version}: 1.5, 65.5, 70, -1 m -> {found.round(3).tolist()}, warnings {warned}")
print(f"NaN -> {unknown.tolist()}, warnings {warned_of_nan}")
if not (np.allclose(found, [1.5, 65.5, 4.464, 64.536]) and warned == 0 and unknown[0] == 0 and warned_of_nan == 1):
    raise SystemExit("the behaviour has changed")
PYTHON
