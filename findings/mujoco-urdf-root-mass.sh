#!/bin/sh
# MuJoCo reads a URDF whose root link has a mass.
# Guessed: the model has the mass of all links.
# Measured on 2026-11-27 with mujoco 4.0.0: the root link is melted into the world, and its mass is in no body (1 kg of 3 kg
# is left); <compiler fusestatic="false"/> in the element <mujoco> keeps it.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install mujoco==4.0.0
python - <<'PYTHON'
import mujoco

LINK = """<link name="{name}"><inertial><mass value="{kg}"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
URDF = """<robot name="two">{option}{root}{arm}<joint name="hinge" type="revolute"><parent link="root"/>
<child link="arm"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def mass(option):
    text = URDF.format(
        option=option, root=LINK.format(name="root", kg=2), arm=LINK.format(name="arm", kg=1)
    )
    return float(mujoco.MjModel.from_xml_string(text).body_mass.sum())


plain = mass("")
kept = mass('<mujoco><compiler fusestatic="false"/></mujoco>')
print(f"mujoco {mujoco.__version__}: {plain:g} of 3 kg; with fusestatic=false {kept:g} kg")
if (plain, kept) != (1.0, 3.0):
    raise SystemExit("the behaviour has changed")
PYTHON
