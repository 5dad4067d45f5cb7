#!/bin/sh
# An MJCF thigh has three hinges, as hips of people do, with one `pos`, .1 m above its origin. The knee has no limits.
# mjcf-urdf-simple-converter, which has a link of its own for each of several joints, makes URDF of it.
# Guessed: joints are where they were, and the knee turns without limits, or a message names what is lost.
# Measured on 2026-11-30 with mjcf-urdf-simple-converter 0.7.3: two hinges are right. The third is set back by their
# place a second time, so the knee is .1 m beside its place in any pose. The knee is "revolute" with the limits 0 and 0,
# so it cannot turn. It says neither.
. "$(dirname "$0")/common.sh"
install mjcf-urdf-simple-converter==0.7.3 mujoco==4.0.0 yourdfpy==0.0.60 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np
from mjcf_urdf_simple_converter import convert
from yourdfpy import URDF

LEG = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="pelvis" pos="0 0 1">
      <geom type="sphere" size=".1" mass="10"/>
      <body name="thigh" pos="0 0 -.2">
        {hip}
        <geom type="sphere" size=".1" mass="5"/>
        <body name="shank" pos="0 0 -.4">
          <joint name="knee" type="hinge" axis="1 0 0"/>
          <geom type="sphere" size=".1" mass="3"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>"""
HINGE = '<joint name="{name}" type="hinge" axis="{axis}" pos="0 0 .1" range="-1 1"/>'
AXES = {"hip_x": "1 0 0", "hip_y": "0 1 0", "hip_z": "0 0 1"}


def beside(names, angle):
    """How far the shank of the URDF is from MuJoCo's, m, and the limits of the knee."""
    hip = "".join(HINGE.format(name=name, axis=AXES[name]) for name in names)
    Path("leg.xml").write_text(LEG.format(hip=hip))
    convert("leg.xml", "leg.urdf")
    model = mujoco.MjModel.from_xml_path("leg.xml")
    data = mujoco.MjData(model)
    for name in names:
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    robot = URDF.load("leg.urdf", load_meshes=False)
    robot.update_cfg({name: angle for name in names})
    place = robot.get_transform("shank", "world")[:3, 3]
    knee = robot.joint_map["knee"]
    off = round(float(np.linalg.norm(place - data.body("shank").xpos)), 2)
    return off, knee.type, knee.limit.lower, knee.limit.upper


seen = {
    f"{len(names)} hinges, {angle} rad": beside(names, angle)
    for names in (["hip_x", "hip_y"], ["hip_x", "hip_y", "hip_z"])
    for angle in (0.0, 0.3)
}
print(f"mjcf-urdf-simple-converter {version('mjcf-urdf-simple-converter')}: shank {seen}")
knee = ("revolute", 0.0, 0.0)
if list(seen.values()) != [(0.0, *knee), (0.0, *knee), (0.1, *knee), (0.1, *knee)]:
    raise SystemExit("the behaviour has changed")
PYTHON
