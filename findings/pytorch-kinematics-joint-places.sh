#!/bin/sh
# An MJCF thigh, whose origin is at its middle, turns about the hip, .2 m above it (`pos` of the joint). A second leg has
# its hinge at the origin, and rests at `ref`. pytorch-kinematics makes a chain of either.
# Guessed: the feet are where MuJoCo has them, or the chain is refused, as for two joints in one body.
# Measured on 2026-11-30 with pytorch-kinematics 0.10.0 and mujoco 3.3.7: the thigh turns about the hip, but its own
# place is put there, too, so the foot is .2 m too high at rest, and .2 m off in any pose. `ref` is left out, and a foot
# is .47 m off. It says neither. A joint without limits has the limits 0 and 0.
. "$(dirname "$0")/common.sh"
install pytorch-kinematics==0.10.0 mujoco==3.3.7 torch==2.13.0 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version

import mujoco
import numpy as np
import pytorch_kinematics
import torch

LEG = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="pelvis" pos="0 0 1">
      <geom type="sphere" size=".1" mass="10"/>
      <body name="thigh" pos="0 0 {thigh}">
        <joint name="hip" type="hinge" axis="1 0 0" {hip}/>
        <geom type="capsule" size=".05" fromto="0 0 -.2 0 0 .2" mass="8"/>
        <body name="foot" pos="0 0 -.6">
          <geom type="sphere" size=".05" mass="1"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>"""


def beside(thigh, hip, angle):
    """How far the foot of the chain is from MuJoCo's, m, and the limits of the joint."""
    text = LEG.format(thigh=thigh, hip=hip)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = angle
    mujoco.mj_forward(model, data)
    chain = pytorch_kinematics.build_chain_from_mjcf(text)
    place = chain.forward_kinematics(torch.tensor([angle]))["foot"].get_matrix()[0, :3, 3]
    off = np.linalg.norm(place.numpy() - data.body("foot").xpos)
    return round(float(off), 2), np.ravel(chain.get_joint_limits()).tolist()


seen = {
    "hinge at the origin, .5 rad": beside(-0.2, "", 0.5),
    "hinge .2 m above, 0 rad": beside(-0.2, 'pos="0 0 .2"', 0.0),
    "hinge .2 m above, .5 rad": beside(-0.2, 'pos="0 0 .2"', 0.5),
    "rests at ref, .5 rad": beside(-0.2, 'ref=".8"', 0.5),
}
print(f"pytorch-kinematics {version('pytorch-kinematics')}, mujoco {version('mujoco')}: foot {seen}")
if [off for off, _ in seen.values()] != [0.0, 0.2, 0.2, 0.47]:
    raise SystemExit("the behaviour has changed: the place of the foot")
if any(limits != [0.0, 0.0] for _, limits in seen.values()):
    raise SystemExit("the behaviour has changed: the limits of a joint without limits")
PYTHON
