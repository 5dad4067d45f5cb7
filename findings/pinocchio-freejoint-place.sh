#!/bin/sh
# The body of an MJCF model has a free joint, stands 3 m up and is turned by 90 degrees.
# Guessed: for MuJoCo's coordinates, Pinocchio has the body where MuJoCo has it, as it does where the body is not
# turned.
# Measured on 2026-11-28 with pin 4.1.0: a turned body is moved by a constant, its place minus its place turned; an
# unturned one is not.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install pin==4.1.0 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import pinocchio

MODEL = (
    '<mujoco><worldbody><body name="pelvis" pos="1 2 3" quat="{}"><freejoint name="root"/>'
    '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>'
)


def place(quaternion):
    """Return where the body is for coordinates that put it at the origin."""
    with open("body.xml", "w", encoding="utf-8") as file:
        file.write(MODEL.format(quaternion))
    model = pinocchio.buildModelFromMJCF("body.xml")
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array([0, 0, 0, 0, 0, 0, 1.0]))
    return data.oMf[model.getFrameId("pelvis")].translation.round(3)


plain = place("1 0 0 0")
turned = place("0.70710678 0.70710678 0 0")
version = importlib.metadata.version("pin")
print(f"pin {version}: a body at the origin is at {plain.tolist()}, if the file turns it at {turned.tolist()}")
if np.abs(plain).max() > 1e-6 or np.abs(turned - [0, 5, 1]).max() > 1e-3:
    raise SystemExit("the behaviour has changed")
PYTHON
