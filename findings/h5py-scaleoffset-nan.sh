#!/bin/sh
# A depth map is stored in HDF5 with three decimals (`scaleoffset=3`), as h5py offers it for floats. One pixel is not
# known (NaN).
# Guessed: NaN comes back, or the file is refused when it is written.
# Measured on 2026-11-29 with h5py 3.16.0 (HDF5 2.0.0) on x86-64: NaN comes back as the smallest depth of its chunk,
# in silence: what is not known is nearest. If the first pixel of a chunk is NaN, all of the chunk is lost: it is
# written, but reading fails.
# Readers guessed: right, in part, in part.
. "$(dirname "$0")/common.sh"
install h5py==3.16.0 numpy==2.4.6
python -W error - <<'PYTHON'
import h5py
import numpy as np


def again(unknown):
    depth = np.linspace(2, 3, 64, dtype=np.float32)
    depth[unknown] = np.nan
    with h5py.File("depth.h5", "w") as file:
        file.create_dataset("depth", data=depth, chunks=(64,), scaleoffset=3)
    with h5py.File("depth.h5") as file:
        try:
            return file["depth"][:]
        except OSError:
            return None


inside, first = again(40), again(0)
smallest, largest = inside.min(), inside.max()
print(f"h5py {h5py.version.version}, HDF5 {h5py.version.hdf5_version}: depths from {smallest:.3f} to {largest:.3f} m")
print(f"the pixel that is not known: {inside[40]:.3f} m; read with NaN in the first pixel: {first is not None}")
if not (first is None and abs(inside[40] - 2) < 1e-3 and abs(largest - 3) < 1e-3):
    raise SystemExit("the behaviour has changed")
PYTHON
