#!/bin/sh
# The hand of a body lies in its belly: one mesh of two closed parts that overlap. Is a point in both parts inside?
# Guessed: trimesh and PyVista, which count crossings, say no; trimesh's signed distance asks the same question, and
# has it outside, too.
# Measured on 2026-11-30 with trimesh 5.2.0 and pyvista 0.49.1: trimesh contradicts itself, in silence: by `contains`
# the point is outside, by `proximity.signed_distance` it is inside, 3.8 cm deep. PyVista's `select_interior_points`
# has it inside. All agree on points in the belly alone, in the hand alone, and outside.
. "$(dirname "$0")/common.sh"
install trimesh==5.2.0 rtree==1.4.1 scipy==1.17.1 pyvista==0.49.1 vtk==9.7.2 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pyvista
import trimesh

belly = trimesh.creation.icosphere(3, 0.3)
hand = trimesh.creation.icosphere(3, 0.1).apply_translation([0.3, 0.013, 0.007])
body = trimesh.util.concatenate([belly, hand])
# in both, in the belly, in the hand, outside
points = np.array([[0.26, 0.011, 0.013], [0.013, 0.02, 0.1], [0.37, 0.012, 0.02], [0.6, 0.013, 0.01]])
selected = pyvista.PolyData(points).select_interior_points(pyvista.wrap(body))["selected_points"]
depth = trimesh.proximity.signed_distance(body, points)
seen = {
    "contains": body.contains(points).tolist(),
    "signed distance": (depth > 0).tolist(),
    "pyvista": np.asarray(selected).astype(bool).tolist(),
}
print(f"trimesh {version('trimesh')}, pyvista {version('pyvista')}: inside {seen}, {100 * depth[0]:.1f} cm deep")
rest = [True, True, False]
wanted = {"contains": [False, *rest], "signed distance": [True, *rest], "pyvista": [True, *rest]}
if seen != wanted or not body.is_watertight:
    raise SystemExit("the behaviour has changed")
PYTHON
