#!/bin/sh
# holosoma-retargeting takes positions of joints in LAFAN1's own order (left leg first, left arm first; y up) and
# turns them to z up. A person who faces +z raises the left hand.
# Guessed: the robot's left hand is raised.
# Measured on 2026-11-27 with holosoma-retargeting 0.1.0: its list of names has the right side first, and its change
# of axes is a reflection (x, z, y). Both together move the hand that is called right: the robot does the mirrored
# motion, in silence.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install --no-deps holosoma-retargeting==0.1.0 numpy==2.4.6 \
    scipy==1.17.1 trimesh==5.2.0 jinja2==3.1.6 markupsafe==3.0.3
python - <<'PYTHON'
import importlib.metadata
import sys
import types

import numpy as np

for unused in ("smplx", "torch"):  # imported beside the function, which needs neither
    sys.modules[unused] = types.ModuleType(unused)
from holosoma_retargeting.config_types.data_type import DEMO_JOINTS_REGISTRY
from holosoma_retargeting.src.utils import transform_y_up_to_z_up

LEG = ["UpLeg", "Leg", "Foot", "Toe"]
ARM = ["Shoulder", "Arm", "ForeArm", "Hand"]
LAFAN1 = ["Hips", *(f"Left{name}" for name in LEG), *(f"Right{name}" for name in LEG)]
LAFAN1 += ["Spine", "Spine1", "Spine2", "Neck", "Head"]
LAFAN1 += [*(f"Left{name}" for name in ARM), *(f"Right{name}" for name in ARM)]

points = np.zeros((1, 22, 3))
points[0, :, 1] = 1.0  # all 1 m above the floor
for index, name in enumerate(LAFAN1):
    points[0, index, 0] = 0.3 * name.startswith("Left") - 0.3 * name.startswith("Right")
points[0, LAFAN1.index("LeftHand"), 1] = 2.0
made = transform_y_up_to_z_up(points)[0]
names = DEMO_JOINTS_REGISTRY["lafan"]
raised = names[int(made[:, 2].argmax())]
axes = np.stack([transform_y_up_to_z_up(axis) for axis in np.eye(3)])
left_x = made[names.index("LeftArm"), 0]  # of a person who faces +y with z up, the left is at -x
version = importlib.metadata.version("holosoma-retargeting")
determinant = round(float(np.linalg.det(axes)))
print(f"holosoma-retargeting {version}: raised is {raised}, LeftArm at x {left_x:+.1f}, determinant {determinant:+d}")
if not (raised == "RightHand" and left_x < 0 and determinant == -1):
    raise SystemExit("the behaviour has changed")
PYTHON
