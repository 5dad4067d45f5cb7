#!/bin/sh
# OpenCV finds the corners of an AprilTag, which fills columns 180 to 499 of a picture, in each of its ways of
# refining corners.
# Guessed: the middle of the corners is the middle of the tag, 339.5, since pixels count from their middles.
# Measured on 2026-11-29 with opencv-python-headless 5.0.0.93: so it is without refinement, and with
# CORNER_REFINE_SUBPIX and CORNER_REFINE_CONTOUR. With CORNER_REFINE_APRILTAG it is 340, half a pixel to the right and
# below, in its own units. pupil-apriltags 1.0.4.post11 counts from edges of pixels, too, so its corners do not fit a
# camera of OpenCV.
. "$(dirname "$0")/common.sh"
install opencv-python-headless==5.0.0.93 \
    pupil-apriltags==1.0.4.post11 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import cv2
import numpy as np
import pupil_apriltags

SIZE = 320
words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
picture = np.full((640, 640), 255, np.uint8)
picture[160 : 160 + SIZE, 180 : 180 + SIZE] = cv2.aruco.generateImageMarker(words, 5, SIZE)
picture = cv2.GaussianBlur(picture, (0, 0), 1.5)
middle = np.array([180, 160]) + (SIZE - 1) / 2
settings = cv2.aruco.DetectorParameters()
off = {}
for name in ("NONE", "SUBPIX", "CONTOUR", "APRILTAG"):
    settings.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{name}")
    corners = cv2.aruco.ArucoDetector(words, settings).detectMarkers(picture)[0]
    off[name] = corners[0][0].mean(axis=0) - middle
detector = pupil_apriltags.Detector(families="tag36h11", quad_decimate=1.0)
off["pupil-apriltags"] = detector.detect(picture)[0].corners.mean(axis=0) - middle
print(f"cv2 {cv2.__version__}, pupil-apriltags {importlib.metadata.version('pupil-apriltags')}: off by, in px")
for name, shift in off.items():
    print(f"  {name}: {np.round(shift, 3).tolist()}")
half = np.array([off["APRILTAG"], off["pupil-apriltags"]])
whole = np.array([off["NONE"], off["SUBPIX"], off["CONTOUR"]])
if not (np.abs(half - 0.5).max() < 0.03 and np.abs(whole).max() < 0.01):
    raise SystemExit("the behaviour has changed")
PYTHON
