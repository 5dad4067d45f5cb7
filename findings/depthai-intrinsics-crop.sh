#!/bin/sh
# DepthAI states the intrinsics of a camera of 1280 x 800 px, with a focal length of 1000 px, for a picture of 640 x
# 480 px.
# Guessed: as documented of keepAspectRatio, which is on by default, the picture is scaled by .6 and cropped: a focal
# length of 600 px, and a centre of 326 and 234 px.
# Measured on 2026-11-29 with depthai 3.12.0: 500 px, and 325 and 235 px, which are those of a picture scaled by .5
# between bars of 40 px. For 1920 x 1080 px it crops. No camera is needed.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install depthai==3.12.0 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import depthai
import numpy as np

SOCKET = depthai.CameraBoardSocket.CAM_A
calibration = depthai.CalibrationHandler()
calibration.setCameraIntrinsics(SOCKET, [[1000.0, 0, 650], [0, 1000, 390], [0, 0, 1]], 1280, 800)


def intrinsics(width, height):
    matrix = np.array(calibration.getCameraIntrinsics(SOCKET, width, height))
    return matrix[[0, 1, 0, 1], [0, 1, 2, 2]].round(3).tolist()


narrow, wide = intrinsics(640, 480), intrinsics(1920, 1080)
print(f"depthai {importlib.metadata.version('depthai')}: fx, fy, cx, cy: 640 x 480: {narrow}, 1920 x 1080: {wide}")
if not (narrow == [500, 500, 325, 235] and wide == [1500, 1500, 975, 525]):
    raise SystemExit("the behaviour has changed")
PYTHON
