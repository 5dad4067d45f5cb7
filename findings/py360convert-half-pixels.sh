#!/bin/sh
# A panorama whose pixels hold their own directions becomes a perspective picture of 90 degrees, 8 px wide, and a cube
# and a panorama again.
# Guessed: the middle of the first pixel lies half a pixel inside of the border, and the panorama comes back in its
# place.
# Measured on 2026-11-28 with py360convert 1.0.4: the middle of the first pixel lies on the border, so a pixel is 1/7
# of the width, and the focal length is 3.5 px in place of 4. Through a cube the panorama is shifted by half a pixel
# to the side.
. "$(dirname "$0")/common.sh"
install py360convert==1.0.4 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import py360convert

HEIGHT, WIDTH, SIDE = 512, 1024, 8
longitude = ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5) * 2 * np.pi
latitude = (0.5 - (np.arange(HEIGHT)[:, None] + 0.5) / HEIGHT) * np.pi
x = np.cos(latitude) * np.sin(longitude)
z = np.cos(latitude) * np.cos(longitude)
panorama = np.stack([x, np.sin(latitude) + 0 * x, z], axis=-1).astype(np.float32)
view = py360convert.e2p(panorama, fov_deg=(90, 90), u_deg=0, v_deg=0, out_hw=(SIDE, SIDE), mode="bilinear")
first = view[SIDE // 2, 0, 0] / view[SIDE // 2, 0, 2]
focal = (SIDE - 1) / 2 / -first
cube = py360convert.e2c(panorama, face_w=256, cube_format="dice")
back = py360convert.c2e(cube, HEIGHT, WIDTH, cube_format="dice")
row = HEIGHT // 2
slope = np.gradient(panorama[row, :, 0])
steep = np.abs(slope) > 0.003
shift = float(np.median((back - panorama)[row, steep, 0] / slope[steep]))
version = importlib.metadata.version("py360convert")
print(f"py360convert {version}: first pixel at {first:.3f} of -1, focal length {focal:.2f} px, shift {shift:.2f} px")
if not (abs(first + 1) < 1e-3 and abs(abs(shift) - 0.5) < 0.05):
    raise SystemExit("the behaviour has changed")
PYTHON
