#!/bin/sh
# Open3D makes an RGB-D image of a depth map of 3.5 m in mm, and points of it.
# Guessed: each pixel gives a point.
# Measured on 2026-11-27 with open3d 0.20.0: none does, without a warning: depth_trunc is 3 m unless stated. Needs the
# system libraries of its wheel (Debian: libusb-1.0-0, libgl1, libegl1, libx11-6).
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install open3d==0.20.0
python - <<'PYTHON'
import numpy as np
import open3d as o3d

color = o3d.geometry.Image(np.full((40, 60, 3), 90, np.uint8))
depth = o3d.geometry.Image(np.full((40, 60), 3500, np.uint16))
camera = o3d.camera.PinholeCameraIntrinsic(60, 40, 50.0, 50.0, 29.5, 19.5)


def points(**options):
    pair = o3d.geometry.RGBDImage.create_from_color_and_depth(color, depth, depth_scale=1000, **options)
    return len(o3d.geometry.PointCloud.create_from_rgbd_image(pair, camera).points)


cut = points()
whole = points(depth_trunc=100)
print(f"open3d {o3d.__version__}: {cut} of 2400 points, with depth_trunc=100 {whole}")
if (cut, whole) != (0, 2400):
    raise SystemExit("the behaviour has changed")
PYTHON
