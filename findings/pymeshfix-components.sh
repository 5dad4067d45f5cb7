#!/bin/sh
# A box of 1 m, which lacks one triangle, stands for a body of few faces, and a closed ball of 5 cm for an eye of
# many. pymeshfix repairs the mesh with its defaults.
# Guessed: the hole is closed, and both parts stay; or, since the option is called `remove_smallest_components`, the
# ball goes.
# Measured on 2026-11-29 with pymeshfix 0.18.1: the box is gone, and the ball is left: the part with most triangles
# counts as the largest. It does not say so. With remove_smallest_components=False both stay, and the hole is closed.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install pymeshfix==0.18.1 trimesh==5.2.0 numpy==2.4.6
python -W error - <<'PYTHON'
import importlib.metadata

import numpy as np
import pymeshfix
import trimesh

box = trimesh.creation.box((1, 1, 1))
ball = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
vertices = np.vstack([box.vertices, ball.vertices + [0, 0, 2]])
faces = np.vstack([box.faces[:-1], ball.faces + len(box.vertices)])


def repaired(**options):
    mesh = pymeshfix.MeshFix(vertices, faces)
    mesh.repair(**options)
    return len(mesh.faces), round(float(np.ptp(mesh.points[:, 0])), 2)


default, kept = repaired(), repaired(remove_smallest_components=False)
print(f"pymeshfix {importlib.metadata.version('pymeshfix')}: {len(faces)} faces, 1 m wide")
print(f"by default {default[0]} faces, {default[1]} m wide; with remove_smallest_components=False {kept}")
if not (default == (len(ball.faces), 0.1) and kept == (len(box.faces) + len(ball.faces), 1)):
    raise SystemExit("the behaviour has changed")
PYTHON
