#!/bin/sh
# A URDF leg has a thigh, a capsule whose moments of inertia are turned (rpy of <inertial>), and a shank, a cylinder. Its
# hip turns about x, with a damping of .7. PyBullet loads it, and its own urdfEditor saves it.
# Guessed: axis, limits, masses and shapes come back, perhaps without a colour or the damping.
# Measured on 2026-11-30 with pybullet 3.2.7: limits and masses do. The axis is written in the frame
# of the moments of inertia, so the hip turns about an axis that is .3 rad off. The cylinder becomes a mesh
# "unknown_file", so PyBullet refuses its own file. Each damping is 1. It says none of it.
. "$(dirname "$0")/common.sh"
install pybullet==3.2.7 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pybullet
from pybullet_utils.urdfEditor import UrdfEditor

INERTIA = '<inertia ixx=".1" iyy=".2" izz=".3" ixy="0" ixz="0" iyz="0"/>'
LEG = f"""
<robot name="leg">
  <link name="pelvis"><inertial><mass value="10"/>{INERTIA}</inertial></link>
  <link name="thigh">
    <inertial><origin xyz="0 0 -.2" rpy="0 .3 0"/><mass value="8"/>{INERTIA}</inertial>
    <collision>
      <origin xyz="0 0 -.2"/><geometry><capsule radius=".05" length=".3"/></geometry>
    </collision>
  </link>
  <link name="shank">
    <inertial><mass value="3"/>{INERTIA}</inertial>
    <collision><geometry><cylinder radius=".05" length=".3"/></geometry></collision>
  </link>
  <joint name="hip" type="revolute">
    <parent link="pelvis"/><child link="thigh"/><origin xyz="0 .1 -.1"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="2" effort="50" velocity="3"/><dynamics damping=".7"/>
  </joint>
  <joint name="knee" type="revolute">
    <parent link="thigh"/><child link="shank"/><origin xyz="0 0 -.4"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="2" effort="50" velocity="3"/><dynamics damping=".7"/>
  </joint>
</robot>"""

Path("leg.urdf").write_text(LEG)
client = pybullet.connect(pybullet.DIRECT)
editor = UrdfEditor()
editor.initializeFromBulletBody(pybullet.loadURDF("leg.urdf"), client)
editor.saveUrdf("saved.urdf")

try:
    pybullet.loadURDF("saved.urdf")
    loaded = "read"
except pybullet.error:
    loaded = "refused"
robot = ElementTree.parse("saved.urdf")
hip = robot.find("joint[@name='hip']")
shank = robot.find("link[@name='shank']/collision/geometry")[0]
seen = {
    "axis": hip.find("axis").get("xyz"),
    "limits": [hip.find("limit").get(name) for name in ("lower", "upper", "effort")],
    "damping": hip.find("dynamics").get("damping"),
    "shank": shank.get("filename", shank.tag),
    "PyBullet": loaded,
}
print(f"pybullet {version('pybullet')}: {seen}")
before = {
    "axis": "0.95534 0.00000 0.29552",
    "limits": ["-1.00000", "2.00000", "50.00000"],
    "damping": "1.0",
    "shank": "unknown_file",
    "PyBullet": "refused",
}
if seen != before:
    raise SystemExit("the behaviour has changed")
PYTHON
