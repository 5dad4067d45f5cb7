#!/bin/sh
# COLMAP and OpenCV, each by its defaults, give the pinhole camera of an undistorted picture of 1920 x 1440 px: of a
# fisheye with a focal length of 870 px, and of a lens with 1200 px and the distortion -.25, .08.
# Guessed: COLMAP keeps size and focal length, and OpenCV's focal length is within 10 % of it.
# Measured on 2026-12-01 with pycolmap 4.2.1 and opencv-python-headless 5.0.0.93: COLMAP keeps the focal length, and its
# pictures are 3220 x 1833 and 2287 x 1588 px. OpenCV keeps the size; its focal lengths are 682 (22 % shorter), and 1007
# and 1087 px: x and y differ.
. "$(dirname "$0")/common.sh"
install pycolmap==4.2.1 opencv-python-headless==5.0.0.93 numpy==2.4.6
python - <<'PYTHON'
import cv2
import numpy as np
import pycolmap

SIZE = (1920, 1440)
found = []
for model, focal, lens in (
    ("OPENCV_FISHEYE", 870, [0.04, -0.02, 0.005, -0.001]),
    ("OPENCV", 1200, [-0.25, 0.08, 0, 0]),
):
    camera = pycolmap.Camera(model=model, width=SIZE[0], height=SIZE[1], params=[focal, focal, 960, 720, *lens])
    flat = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), camera)
    K, D = np.array([[focal, 0, 960], [0, focal, 720], [0, 0, 1.0]]), np.array(lens, float)
    if model == "OPENCV":
        K = cv2.getOptimalNewCameraMatrix(K, D, SIZE, 0)[0]
    else:
        K = cv2.fisheye.estimateNewCameraMatrixForUndistortRectify(K, D, SIZE, np.eye(3))
    found.append([flat.width, flat.height, *flat.params[:2].tolist(), *K.diagonal()[:2].round().tolist()])
print(f"pycolmap {pycolmap.__version__}, opencv {cv2.__version__}: width, height, fx, fy; OpenCV's fx, fy: {found}")
if not np.allclose(found, [[3220, 1833, 870, 870, 682, 682], [2287, 1588, 1200, 1200, 1007, 1087]], atol=1):
    raise SystemExit("the behaviour has changed")
PYTHON
