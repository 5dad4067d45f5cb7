#!/bin/sh
# A mesh has two parts that nothing connects, as bodies whose eyes are balls of their own have. Distances along the
# surface are measured from a vertex of the first part.
# Guessed: those of the other part are infinite, or NaN.
# Measured on 2026-11-29 with potpourri3d 1.4.0: its heat method answers 1.55 m for all of the other part, half of the
# largest distance on the first, though it lies 100 m away, for the mesh and for its points. Its fast marching answers
# infinity.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install potpourri3d==1.4.0 trimesh==5.2.0 scipy==1.17.1 \
    numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import potpourri3d
import trimesh

ball = trimesh.creation.icosphere(subdivisions=3)
count = len(ball.vertices)
vertices = np.vstack([ball.vertices, ball.vertices + [100, 0, 0]])
faces = np.vstack([ball.faces, ball.faces + count])
found = {
    "heat, mesh": potpourri3d.MeshHeatMethodDistanceSolver(vertices, faces).compute_distance(0),
    "heat, points": potpourri3d.PointCloudHeatSolver(vertices).compute_distance(0),
    "fast marching": potpourri3d.MeshFastMarchingDistanceSolver(vertices, faces).compute_distance([[(0, [])]]),
}
print(f"potpourri3d {importlib.metadata.version('potpourri3d')}, a ball of radius 1 m, and another 100 m away:")
for name, distance in found.items():
    near, far = distance[:count], distance[count:]
    print(f"  {name}: at most {near.max():.2f} m; on the other ball {far.min():.2f} to {far.max():.2f} m")
heat = np.concatenate([found["heat, mesh"][count:], found["heat, points"][count:]])
if not (np.ptp(heat) < 0.01 and abs(heat[0] - 1.55) < 0.02 and np.isinf(found["fast marching"][count:]).all()):
    raise SystemExit("the behaviour has changed")
PYTHON
