#!/bin/sh
# The hand of a body lies in its belly, as bodies of networks often have it: one mesh of two closed parts that overlap
# (balls of .3 m and .1 m). How deep in the mesh is a point in both parts, 7.7 cm under the nearest skin?
# Guessed: point-cloud-utils and libigl state it inside, by the winding number, and its distance to the nearest skin.
# Measured on 2026-11-30 with libigl 2.6.3 and point-cloud-utils 0.34.0: the sign is right, and the distance is 23.0
# cm, three times too far, in silence, by the defaults of both: libigl multiplies by 1 - 2w, and the winding number w
# is 2 there. A second hand makes it 38.4 cm. With the sign of pseudonormals libigl has 7.7 cm.
. "$(dirname "$0")/common.sh"
install libigl==2.6.3 point-cloud-utils==0.34.0 trimesh==5.2.0 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import igl
import numpy as np
import point_cloud_utils
import trimesh

POINT = np.array([[0.22, 0.012, 0.011]] * 2)  # alone, it gets another answer: point-cloud-utils-one-point.sh
NORMALS = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL


def depths(hands):
    """Distances that are stated of the point, in centimetres."""
    parts = [trimesh.creation.icosphere(3, 0.3)]
    for number in range(hands):
        parts.append(trimesh.creation.icosphere(3, 0.1).apply_translation([0.2 + number / 100, 0.01, 0]))
    body = trimesh.util.concatenate(parts)
    mesh = np.asarray(body.vertices, np.float64), np.asarray(body.faces, np.int64)
    found = (
        igl.signed_distance(POINT, *mesh)[0],
        igl.signed_distance(POINT, *mesh, sign_type=NORMALS)[0],
        point_cloud_utils.signed_distance_to_mesh(POINT, *mesh)[0],
    )
    return [round(100 * float(np.ravel(one)[0]), 1) for one in found]


seen = {hands: depths(hands) for hands in (0, 1, 2)}
print(
    f"libigl {version('libigl')}, by pseudonormals, point-cloud-utils {version('point-cloud-utils')}: "
    f"cm by number of hands {seen}"
)
wanted = {0: [-7.8, -7.8, -7.8], 1: [-23.0, -7.7, -23.0], 2: [-38.4, -7.7, -38.4]}
if np.abs(np.array(list(seen.values())) - list(wanted.values())).max() > 0.15:
    raise SystemExit("the behaviour has changed")
PYTHON
