#!/bin/sh
# An MJCF model turns a thigh by euler="0 -90 0", and limits its hinge to -45 to 45, both in degrees, which is MJCF's
# own unit.
# Guessed: readers have the knee where MuJoCo has it, and a limit of .785 rad.
# Measured on 2026-11-29 with pybullet 3.2.7 and kinpy 0.6.1, against mujoco 4.0.0: both leave `euler` and `axisangle`
# out in silence, so the knee hangs down in place of ahead. PyBullet's limit is 45 rad, seven turns. `quat` is right
# in both.
# Readers guessed: in part, in part, wrong.
. "$(dirname "$0")/common.sh"
install pybullet==3.2.7 kinpy==0.6.1 \
    mujoco==4.0.0 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import kinpy
import mujoco
import numpy as np
import pybullet

MODEL = """<mujoco><worldbody><body name="thigh" pos="0 0 1" {turn}>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <joint name="hip" type="hinge" axis="0 1 0" range="-45 45" limited="true"/>
  <body name="shank" pos="0 0 -.4"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <joint name="knee" type="hinge" axis="0 1 0"/></body>
</body></worldbody></mujoco>"""
TURNS = {"euler": 'euler="0 -90 0"', "axisangle": 'axisangle="0 -1 0 90"', "quat": 'quat="0.70710678 0 -0.70710678 0"'}


def rounded(place):
    return [round(float(value), 2) + 0.0 for value in place]


def knees(name, text):
    """Return the place of the knee in MuJoCo, PyBullet and kinpy, and PyBullet's limit of the hip."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    path = f"{name}.xml"  # PyBullet keeps the contents of a file by its name
    Path(path).write_text(text)
    body = pybullet.loadMJCF(path)[-1]
    joints = {pybullet.getJointInfo(body, number)[1]: number for number in range(pybullet.getNumJoints(body))}
    own = pybullet.getLinkState(body, joints[b"knee"], computeForwardKinematics=True)[4]
    chain = kinpy.build_chain_from_mjcf(text)
    frames = chain.forward_kinematics(dict.fromkeys(chain.get_joint_parameter_names(), 0.0))
    limit = pybullet.getJointInfo(body, joints[b"hip"])[9]
    return rounded(data.body("shank").xpos), rounded(own), rounded(frames["shank"].pos), limit


pybullet.connect(pybullet.DIRECT)
found = {name: knees(name, MODEL.format(turn=turn)) for name, turn in TURNS.items()}
versions = {name: importlib.metadata.version(name) for name in ("mujoco", "pybullet", "kinpy")}
print(f"{versions}: knee in MuJoCo, PyBullet, kinpy, and PyBullet's limit in rad: {found}")
AHEAD, DOWN = [0.4, 0.0, 1.0], [0.0, 0.0, 0.6]
lost = (AHEAD, DOWN, DOWN, 45.0)
expected = {"euler": lost, "axisangle": lost, "quat": (AHEAD, AHEAD, AHEAD, 45.0)}
if found != expected:
    raise SystemExit("the behaviour has changed")
PYTHON
