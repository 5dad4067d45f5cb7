#!/bin/sh
# The orientation of a sensor on a limb, roll .1, pitch .2 and yaw .3 rad, goes into both classes of AHRS that take
# `rpy`, and both are asked for these angles again.
# Guessed: both are one rotation, and return the angles.
# Measured on 2026-11-29 with ahrs 0.4.0: Quaternion does. DCM takes roll for yaw, and yaw for roll, so it is 18
# degrees off, in silence, and its `to_rpy` returns -.286, -.220 and -.038 rad. Of the matrix of the quaternion it
# returns -.038, -.220 and -.286.
# Readers guessed: right, right, in part.
. "$(dirname "$0")/common.sh"
install ahrs==0.4.0 scipy==1.17.1 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
from ahrs import DCM, Quaternion
from scipy.spatial.transform import Rotation

ANGLES = np.array([0.1, 0.2, 0.3])
quaternion, matrix = Quaternion(rpy=ANGLES), DCM(rpy=ANGLES)
own = Rotation.from_matrix(quaternion.to_DCM())
apart = float(np.degrees((own.inv() * Rotation.from_matrix(np.array(matrix))).magnitude()))
angles = {
    "quaternion": quaternion.to_angles(),
    "matrix": matrix.to_rpy(),
    "matrix of the quaternion": DCM(quaternion.to_DCM()).to_rpy(),
}
angles = {name: np.round(values, 3).tolist() for name, values in angles.items()}
print(f"ahrs {importlib.metadata.version('ahrs')}: {apart:.1f} degrees apart; {angles}")
right = np.allclose(own.as_euler("ZYX"), ANGLES[::-1])
expected = [[0.1, 0.2, 0.3], [-0.286, -0.22, -0.038], [-0.038, -0.22, -0.286]]
if not (right and abs(apart - 17.7) < 0.1 and list(angles.values()) == expected):
    raise SystemExit("the behaviour has changed")
PYTHON
