#!/bin/sh
# A URDF leg of 2 m turns at the hip, by an axis along x, or by one between x and y, as anatomical axes are. The knee
# below follows the hip (<mimic>), by a factor of .5.
# Guessed: the leg hangs down at 0 rad for both axes, and turns about them; the knee is a free joint, or follows.
# Measured on 2026-11-30 with roboticstoolbox-python 1.5.0 and yourdfpy 0.0.60: with the axis along x it does. With the
# other the leg is turned at 0 rad already, so the foot is 1.9 m beside its place, in silence: the frame is turned until
# its z lies along the axis, and not turned back. The knee is a free joint.
. "$(dirname "$0")/common.sh"
install roboticstoolbox-python==1.5.0 yourdfpy==0.0.60 scipy==1.17.1 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import numpy as np
from roboticstoolbox import Robot
from roboticstoolbox.models.URDF.URDFRobot import URDF_read
from yourdfpy import URDF

LEG = """
<robot name="leg">
  <link name="pelvis"/><link name="thigh"/><link name="shank"/><link name="foot"/>
  <joint name="hip" type="revolute">
    <parent link="pelvis"/><child link="thigh"/><axis xyz="{axis}"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
  <joint name="knee" type="revolute">
    <parent link="thigh"/><child link="shank"/><origin xyz="0 0 -1"/><axis xyz="1 0 0"/>
    <mimic joint="hip" multiplier=".5"/><limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
  <joint name="ankle" type="fixed">
    <parent link="shank"/><child link="foot"/><origin xyz="0 0 -1"/>
  </joint>
</robot>"""


def beside(axis, angle):
    """How far the foot is from yourdfpy's place, m, and the number of joints."""
    path = Path("leg.urdf").absolute()
    path.write_text(LEG.format(axis=axis))
    links, name, _ = URDF_read(path)
    robot = Robot(links, name=name)
    angles = np.zeros(robot.n)
    angles[:2] = angle, angle / 2
    place = robot.fkine(angles, end="foot").t
    reference = URDF.load(str(path), load_meshes=False)
    reference.update_cfg({"hip": angle})
    right = reference.get_transform("foot", "pelvis")[:3, 3]
    return round(float(np.linalg.norm(place - right)), 2), robot.n


seen = {
    (axis, angle): beside(axis, angle) for axis in ("1 0 0", ".6 .8 0") for angle in (0.0, 0.5)
}
print(f"roboticstoolbox-python {version('roboticstoolbox-python')}: foot and joints {seen}")
if list(seen.values()) != [(0.0, 2), (0.0, 2), (1.92, 2), (1.06, 2)]:
    raise SystemExit("the behaviour has changed")
PYTHON
