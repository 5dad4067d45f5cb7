#!/bin/sh
# A fisheye lens of 200 degrees sees a joint 100 degrees off its axis, a little behind the camera. Its model is
# OpenCV's own: 100 px for each radian.
# Guessed: the joint is beyond one at 89 degrees, at 374.5 px.
# Measured on 2026-11-29 with opencv-python-headless 5.0.0.93: fisheye.projectPoints has it at 60.4 px, on the other
# side of the picture, where a joint 80 degrees off the axis would be on that side. It takes the angle from x / z,
# whose sign turns.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install opencv-python-headless==5.0.0.93 numpy==2.4.6
python - <<'PYTHON'
import cv2
import numpy as np

K = np.array([[100.0, 0, 200], [0, 100, 200], [0, 0, 1]])
degrees = np.array([80, 89, 100])
angles = np.radians(degrees)
joints = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)
pixels = cv2.fisheye.projectPoints(joints[:, None], np.zeros(3), np.zeros(3), K, np.zeros(4))[0][:, 0, 0]
wanted = 200 + 100 * angles
for degree, pixel, right in zip(degrees, pixels, wanted, strict=True):
    print(f"cv2 {cv2.__version__}: {degree} degrees: {pixel:.1f} px; by the model {right:.1f} px")
other_side = 200 - 100 * np.radians(80)
if not (np.allclose(pixels[:2], wanted[:2]) and np.isclose(pixels[2], other_side)):
    raise SystemExit("the behaviour has changed")
PYTHON
