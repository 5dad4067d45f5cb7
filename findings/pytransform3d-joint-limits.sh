#!/bin/sh
# A joint of a URDF has limits of -1 and 1 rad, and the pose of a person has it at 2.5 rad.
# Guessed: pytransform3d takes 2.5, or refuses it.
# Measured on 2026-11-28 with pytransform3d 3.17.0: it sets 1 rad in silence.
. "$(dirname "$0")/common.sh"
install pytransform3d==3.17.0 numpy==2.4.6 scipy==1.17.1
python - <<'PYTHON'
import importlib.metadata

import numpy as np
from pytransform3d.urdf import UrdfTransformManager

JOINT = (
    '<robot name="arm"><link name="upper"/><link name="lower"/><joint name="elbow" type="revolute">'
    '<parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)


def angle(value):
    arm = UrdfTransformManager()
    arm.load_urdf(JOINT)
    arm.set_joint("elbow", value)
    turned = arm.get_transform("lower", "upper")
    return round(float(np.arctan2(turned[1, 0], turned[0, 0])), 6)


found = (angle(2.5), angle(0.5))
version = importlib.metadata.version("pytransform3d")
print(f"pytransform3d {version}: 2.5 rad becomes {found[0]}, 0.5 rad {found[1]}")
if found != (1, 0.5):
    raise SystemExit("the behaviour has changed")
PYTHON
