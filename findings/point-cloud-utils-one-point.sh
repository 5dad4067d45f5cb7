#!/bin/sh
# How far is a wrist, one point, from the surface of a body, a ball of 30 cm? The same wrist is asked alone, and twice.
# Guessed: the same distance, 7.8 cm inside.
# Measured on 2026-11-30 with point-cloud-utils 0.34.0: asked twice it is. Alone it is 1.4 cm inside by
# `signed_distance_to_mesh`, and .3 cm away by `closest_points_on_mesh`, in silence; `k_nearest_neighbors` differs,
# too.
. "$(dirname "$0")/common.sh"
install point-cloud-utils==0.34.0 trimesh==5.2.0 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import point_cloud_utils
import trimesh

ball = trimesh.creation.icosphere(3, 0.3)
mesh = np.asarray(ball.vertices, np.float64), np.asarray(ball.faces, np.int64)
wrist = np.array([[0.22, 0.012, 0.011]])


def distances(points):
    """Distances in centimetres that are stated of the first point."""
    found = (
        point_cloud_utils.signed_distance_to_mesh(points, *mesh)[0],
        point_cloud_utils.closest_points_on_mesh(points, *mesh)[0],
        point_cloud_utils.k_nearest_neighbors(points, mesh[0], 1)[0],
    )
    return [round(100 * float(np.ravel(one)[0]), 1) for one in found]


alone, twice = distances(wrist), distances(np.repeat(wrist, 2, axis=0))
print(f"point-cloud-utils {version('point-cloud-utils')}: signed, closest, nearest, cm: alone {alone}, twice {twice}")
if (alone, twice) != ([-1.4, 0.3, 7.5], [-7.8, 7.8, 8.2]):
    raise SystemExit("the behaviour has changed")
PYTHON
