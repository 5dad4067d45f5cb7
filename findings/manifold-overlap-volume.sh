#!/bin/sh
# The hand of a body lies in its belly: one closed mesh of two parts that overlap. Manifold, whose results are promised
# to be manifold, adds a stand beside it for printing, and states the volume.
# Guessed: it refuses the mesh, or what the parts share counts once.
# Measured on 2026-11-30 with manifold3d 3.5.4: its status is NoError, and what they share counts twice, before and
# after the union with the stand, and after an intersection with a box around all. `decompose` and a union of the parts
# count it once.
. "$(dirname "$0")/common.sh"
install manifold3d==3.5.4 trimesh==5.2.0 scipy==1.17.1 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import trimesh
from manifold3d import Error, Manifold, Mesh, OpType

belly = trimesh.creation.icosphere(3, 0.3)
hand = trimesh.creation.icosphere(3, 0.1).apply_translation([0.3, 0.013, 0.007])
body = trimesh.util.concatenate([belly, hand])
solid = Manifold(Mesh(np.asarray(body.vertices, np.float32), np.asarray(body.faces, np.uint32)))
stand = Manifold.cube([0.1, 0.1, 0.1]).translate([5, 0, 0])
litres = {
    "both parts": 1000 * (belly.volume + hand.volume),
    "manifold": 1000 * solid.volume(),
    "with the stand": 1000 * ((solid + stand).volume() - stand.volume()),
    "in a box": 1000 * (solid ^ Manifold.cube([4, 4, 4], True)).volume(),
    "union of its parts": 1000 * Manifold.batch_boolean(solid.decompose(), OpType.Add).volume(),
}
seen = {name: round(float(value), 2) for name, value in litres.items()}
print(f"manifold3d {version('manifold3d')}: {solid.status()}, litres {seen}")
twice, once = seen["both parts"], seen.pop("union of its parts")
if solid.status() != Error.NoError or any(abs(value - twice) > 0.02 for value in seen.values()) or twice - once < 1:
    raise SystemExit("the behaviour has changed")
PYTHON
