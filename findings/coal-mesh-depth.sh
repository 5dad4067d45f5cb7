#!/bin/sh
# Coal, which Pinocchio uses, measures how deep two spheres of 50 cm radius overlap whose centers are 80 cm apart: as
# meshes of 320, 1280 and 5120 triangles, and one of them as a sphere.
# Guessed: the deepest contact of `collide` is 10 to 20 cm deep, and `distance` as far below 0.
# Measured on 2026-12-01 with coal 3.0.3: of two meshes it is 7.3, 5.9 and 2.6 cm, less the finer they are, because it is
# of two triangles, and `distance` is 0. With a sphere it is 20 cm, but `distance` is -5.3, -3.6 and -2.1 cm.
. "$(dirname "$0")/common.sh"
install coal==3.0.3 trimesh==5.2.0 numpy==2.4.6
python - <<'PYTHON'
import coal
import numpy as np
import trimesh

here, there = coal.Transform3s(), coal.Transform3s()
there.setTranslation(np.array([0.8, 0, 0]))


def mesh(finer):
    ball = trimesh.creation.icosphere(finer, radius=0.5)
    shape = coal.BVHModelOBBRSS()
    shape.beginModel(len(ball.faces), len(ball.vertices))
    for face in ball.faces:
        shape.addTriangle(*np.asarray(ball.vertices)[face])
    shape.endModel()
    return shape


def measured(one, other):
    request = coal.CollisionRequest()
    request.num_max_contacts = 100_000
    request.enable_contact = True
    result = coal.CollisionResult()
    coal.collide(one, here, other, there, request, result)
    deepest = min(result.getContact(i).penetration_depth for i in range(result.numContacts()))
    gap = coal.distance(one, here, other, there, coal.DistanceRequest(), coal.DistanceResult())
    return [round(float(100 * value), 1) for value in (deepest, gap)]


meshes = [measured(mesh(finer), mesh(finer)) for finer in (2, 3, 4)]
balls = [measured(mesh(finer), coal.Sphere(0.5)) for finer in (2, 3, 4)]
print(f"coal {coal.__version__}: cm of contact and distance: two meshes {meshes}; mesh and sphere {balls}")
wanted = [[-7.3, 0], [-5.9, 0], [-2.6, 0]], [[-20, -5.3], [-20, -3.6], [-20, -2.1]]
if not np.allclose((meshes, balls), wanted, atol=0.2):
    raise SystemExit("the behaviour has changed")
PYTHON
