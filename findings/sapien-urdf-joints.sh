#!/bin/sh
# SAPIEN reads a URDF of a body with two legs of two joints each, with limits of effort and velocity.
# Guessed: the active joints have the order of the file, and the limit of effort is the limit of force.
# Measured on 2026-11-27 with sapien 3.0.3: the order is breadth-first (hips, then knees), so angles in the order of
# the file are those of other joints, and the limits of effort and velocity are left out: the limit of force is
# 3.4e38.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install sapien==3.0.3 numpy==2.4.6 setuptools==80.9.0
python -W ignore - <<'PYTHON'
import importlib.metadata

import sapien

LINK = (
    '<link name="{}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{1}" type="revolute"><parent link="{0}"/><child link="{1}"/><axis xyz="1 0 0"/>'
    '<limit lower="-1" upper="1" effort="100" velocity="5"/></joint>'
)
names = ["left_hip", "left_knee", "right_hip", "right_knee"]
parents = ["pelvis", "left_hip", "pelvis", "right_hip"]
links = "".join(LINK.format(name) for name in ["pelvis", *names])
joints = "".join(JOINT.format(parent, name) for parent, name in zip(parents, names, strict=True))
with open("body.urdf", "w", encoding="utf-8") as file:
    file.write(f'<robot name="body">{links}{joints}</robot>')

scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
active = scene.create_urdf_loader().load("body.urdf").get_active_joints()
order = [joint.name for joint in active]
force = active[0].force_limit
print(f"sapien {importlib.metadata.version('sapien')}: order {order}, limit of force {force:.3g} for an effort of 100")
if not (order == ["left_hip", "right_hip", "left_knee", "right_knee"] and force > 1e38):
    raise SystemExit("the behaviour has changed")
PYTHON
