#!/bin/sh
# PoseLib, which takes cameras by the names and parameters of COLMAP's models, is given 60 points in front of a camera
# 1 m beside the origin, and their pixels, which pycolmap projects. Each of COLMAP's models is tried.
# Guessed: PoseLib finds the pose for each, or refuses a model that it does not have.
# Measured on 2026-11-30 with poselib 2.0.5 and pycolmap 4.2.1: of seven of them it does. Each of FOV,
# SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and THIN_PRISM_FISHEYE becomes a camera NULL, in silence, and the pose is that
# of no rotation at the origin, with 0 inliers. A name that nobody has fares alike.
. "$(dirname "$0")/common.sh"
install poselib==2.0.5 pycolmap==4.2.1 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import poselib
import pycolmap

FOUR = [900, 950, 640, 480]
MODELS = {
    "SIMPLE_PINHOLE": [900, 640, 480],
    "PINHOLE": FOUR,
    "SIMPLE_RADIAL": [900, 640, 480, 0.1],
    "RADIAL": [900, 640, 480, 0.1, 0.02],
    "OPENCV": [*FOUR, 0.1, 0.02, 0.003, -0.004],
    "OPENCV_FISHEYE": [*FOUR, 0.1, 0.02, 0.003, -0.004],
    "FULL_OPENCV": [*FOUR, 0.1, 0.02, 0.003, -0.004, 0.01, 0.02, 0.01, 0.003],
    "FOV": [*FOUR, 0.5],
    "SIMPLE_RADIAL_FISHEYE": [900, 640, 480, 0.1],
    "RADIAL_FISHEYE": [900, 640, 480, 0.1, 0.02],
    "THIN_PRISM_FISHEYE": [*FOUR, 0.1, 0.02, 0.003, -0.004, 0.01, 0.02, 0.001, 0.002],
}
points = np.random.default_rng(0).uniform(-1, 1, (60, 3)) + [0, 0, 3]
place = np.array([1.0, 0, 0])


def estimate(pixels, model, params):
    camera = {"model": model, "width": 1280, "height": 960, "params": params}
    pose, info = poselib.estimate_absolute_pose(list(pixels), list(points), camera, {}, {})
    return pose.t, info["num_inliers"]


found, null = [], []
for model, params in MODELS.items():
    camera = pycolmap.Camera(model=model, width=1280, height=960, params=params)
    t, inliers = estimate(camera.img_from_cam(points + place), model, params)
    if inliers == len(points) and np.allclose(t, place, atol=1e-3):
        found.append(model)
    elif inliers == 0 and not np.any(t):
        null.append(model)
names = {model: poselib.Camera(model, MODELS[model], 1280, 960).model_name() for model in null}
_, nobody = estimate(points[:, :2], "NO_SUCH_MODEL", FOUR)
print(f"poselib {version('poselib')}, pycolmap {version('pycolmap')}: found {found}, not {names}")
print(f"inliers of a camera with a name that nobody has: {nobody}")
if found != list(MODELS)[:7] or set(names.values()) != {"NULL"} or len(names) != 4 or nobody:
    raise SystemExit("the behaviour has changed")
PYTHON
