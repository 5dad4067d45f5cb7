#!/bin/sh
# RealSense's library turns a pixel and its depth into a point, and projects the point again, for each of its models
# of distortion, with valid coefficients.
# Guessed: the pixel comes back.
# Measured on 2026-11-29 with pyrealsense2 2.59.1.11053: not for two of them, in silence. For modified_brown_conrady,
# `rs2_deproject_pixel_to_point` leaves the distortion out, which is 12 px here; for ftheta it divides by an
# arctangent where the model has twice a tangent, which is 61 px. The models none, brown_conrady,
# inverse_brown_conrady and kannala_brandt4 come back. Needs a system library of its wheel (Debian: libusb-1.0-0).
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install pyrealsense2==2.59.1.11053 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import pyrealsense2

PIXEL = [600.0, 400.0]
MODELS = ("none", "brown_conrady", "inverse_brown_conrady", "kannala_brandt4", "modified_brown_conrady", "ftheta")
print(f"pyrealsense2 {importlib.metadata.version('pyrealsense2')}: {PIXEL} becomes")
off = {}
for name in MODELS:
    camera = pyrealsense2.intrinsics()
    camera.width, camera.height, camera.fx, camera.fy, camera.ppx, camera.ppy = 640, 480, 500, 500, 320, 240
    camera.model = getattr(pyrealsense2.distortion, name)
    camera.coeffs = [0.9, 0, 0, 0, 0] if name == "ftheta" else [0.1, -0.05, 0.001, 0.002, 0.01]
    point = pyrealsense2.rs2_deproject_pixel_to_point(camera, PIXEL, 2.0)
    again = pyrealsense2.rs2_project_point_to_pixel(camera, point)
    off[name] = np.hypot(*np.subtract(again, PIXEL))
    print(f"  {name}: {np.round(again, 1).tolist()}, {off[name]:.2f} px off")
right = max(off[name] for name in MODELS[:4]) < 0.05
if not (right and abs(off[MODELS[4]] - 12.3) < 0.2 and abs(off["ftheta"] - 60.7) < 0.5):
    raise SystemExit("the behaviour has changed")
PYTHON
