#!/bin/sh
# A shin, a capsule of 10 cm radius and 60 cm length, stands upright in a table top, a box 2 cm thick, half through
# it.
# Guessed: MuJoCo has the depth of 31 cm that coal and PyBullet have, and a contact.
# Measured on 2026-11-29 with mujoco 4.0.0: mj_geomDistance answers +9 cm, and there is no contact, so a leg that is
# half through a thin board falls through it: it measures from the ends of the capsule's axis, which are 20 cm above
# and below. A capsule that is 10 cm higher touches with -1 cm, in place of -21 cm. coal 3.0.3 and pybullet 3.2.7 have
# -31 and -21 cm, and so has MuJoCo for the same board as a mesh.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install mujoco==4.0.0 coal==3.0.3 pybullet==3.2.7 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version
from itertools import product

import coal
import mujoco
import numpy as np
import pybullet

SIDES = np.array([0.5, 0.5, 0.01])
BOX = '<geom type="box" size="0.5 0.5 0.01"/>'
CORNERS = " ".join(map(str, np.ravel([SIDES * signs for signs in product((-1, 1), repeat=3)])))
MESH = '<geom type="mesh" mesh="board"/>'
WORLD = f"""<mujoco><asset><mesh name="board" vertex="{CORNERS}"/></asset><worldbody>{{}}<body pos="0.01 0.02 {{}}">
<freejoint/><geom type="capsule" size="0.1 0.2"/></body></worldbody></mujoco>"""


def with_mujoco(board, height):
    model = mujoco.MjModel.from_xml_string(WORLD.format(board, height))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return round(100 * mujoco.mj_geomDistance(model, data, 0, 1, 1.0, np.zeros(6))), data.ncon


def with_coal(height):
    place = coal.Transform3s()
    place.setTranslation(np.array([0.01, 0.02, height]))
    shapes = coal.Capsule(0.1, 0.4), place, coal.Box(1, 1, 0.02), coal.Transform3s()
    return round(100 * coal.distance(*shapes, coal.DistanceRequest(), coal.DistanceResult()))


def with_pybullet(height):
    pybullet.connect(pybullet.DIRECT)
    shin = pybullet.createCollisionShape(pybullet.GEOM_CAPSULE, radius=0.1, height=0.4)
    board = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=SIDES.tolist())
    bodies = pybullet.createMultiBody(1, shin, basePosition=[0.01, 0.02, height]), pybullet.createMultiBody(0, board)
    distance = pybullet.getClosestPoints(*bodies, 1)[0][8]
    pybullet.disconnect()
    return round(100 * distance)


found = [
    (with_mujoco(BOX, height), with_mujoco(MESH, height), with_coal(height), with_pybullet(height))
    for height in (0.0, 0.1)
]
print(f"mujoco {version('mujoco')} (cm, contacts) with a box and a mesh, coal, pybullet: {found}")
if found != [((9, 0), (-31, 1), -31, -31), ((-1, 1), (-21, 1), -21, -21)]:
    raise SystemExit("the behaviour has changed")
PYTHON
