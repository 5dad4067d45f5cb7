#!/bin/sh
# A trimesh camera has a matrix K, whose v grows downward, and `to_rays` returns a ray and a pixel for each pixel.
# Guessed: the ray of pixel (0, 0) is that of K there, to the upper left of what the camera sees (it looks along -z,
# with y up).
# Measured on 2026-11-28 with trimesh 5.2.0: pixel (0, 0) is the lower left one: rows count from below. Columns and
# half pixels agree with K.
# Readers guessed: wrong, right, wrong.
. "$(dirname "$0")/common.sh"
install trimesh==5.2.0 numpy==2.4.6
python - <<'PYTHON'
import numpy as np
import trimesh

camera = trimesh.scene.Camera(resolution=(8, 4), focal=(10, 10))
rays, pixels = camera.to_rays()
ray = rays[(pixels == 0).all(axis=1)][0]
found = np.round(ray[:2] / -ray[2], 3).tolist()
x, down, _ = np.linalg.inv(camera.K) @ [0.5, 0.5, 1]
print(f"trimesh {trimesh.__version__}: pixel (0, 0) is seen along x, y = {found}; K gives {x:.3f}, {-down:.3f}")
if not (found == [-0.35, -0.15] and abs(x + 0.35) < 1e-9 and abs(-down - 0.15) < 1e-9):
    raise SystemExit("the behaviour has changed")
PYTHON
