#!/bin/sh
# An MJCF body has two joints, as hips and shoulders of people have: two hinges whose `pos` differ, or a hinge before
# a slide.
# Guessed: Drake, Newton and Pinocchio have the child where MuJoCo has it, as they have it for one joint.
# Measured on 2026-11-29 with mujoco 4.0.0, pin 4.1.0, drake 1.51.1 and newton 1.8.0: Pinocchio has. Drake puts the
# first joint at the origin of the parent, in place of the body's, so the child of a body 1 m up is .30 m off for any
# two joints. Newton has the second hinge at the place of the first (.41 m off), turns an axis that is not at right
# angles to the first (.17 m), and does a slide before a hinge (.41 m). Neither says so.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install mujoco==4.0.0 pin==4.1.0 drake==1.51.1 newton==1.8.0 numpy==2.4.6
python -W ignore - 2> log.txt <<'PYTHON' || { cat log.txt >&2; exit 1; }
from importlib.metadata import version

import mujoco
import newton
import numpy as np
import pinocchio
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

MODEL = """<mujoco model="person"><worldbody><body name="thigh" pos="0 0 1">{}<geom size="0.1"/>
<body name="shank" pos="1 0 0"><joint name="knee" axis="0 0 1"/><geom size="0.1"/></body></body></worldbody></mujoco>"""
HINGE = '<joint name="first" axis="0 1 0"{}/>'
JOINTS = {
    "one hinge": HINGE.format(' pos="0 0 0.5"'),
    "one place": HINGE.format("") + '<joint name="second" axis="1 0 0"/>',
    "two places": HINGE.format(' pos="0 0 0.5"') + '<joint name="second" axis="1 0 0" pos="0 0 -0.2"/>',
    "oblique axes": HINGE.format("") + '<joint name="second" axis="0 0.6 0.8"/>',
    "slide last": HINGE.format("") + '<joint name="second" type="slide" axis="1 0 0"/>',
}


def with_mujoco(text, pose):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = list(pose.values())
    mujoco.mj_forward(model, data)
    return data.body("shank").xpos


def with_pinocchio(text, pose):
    with open("person.xml", "w", encoding="utf-8") as file:
        file.write(text)
    model = pinocchio.buildModelFromMJCF("person.xml")
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array(list(pose.values())))
    return data.oMf[model.getBodyId("shank")].translation


def with_drake(text, pose):
    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModelsFromString(text, "xml")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    places = plant.GetPositions(context).copy()
    for name, value in pose.items():
        places[plant.GetJointByName(name).position_start()] = value
    plant.SetPositions(context, places)
    return plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("shank")).translation()


def with_newton(text, pose):
    builder = newton.ModelBuilder()
    builder.add_mjcf(text)
    model = builder.finalize()
    state = model.state()
    model.joint_q.assign(np.array(list(pose.values()), np.float32))
    newton.eval_fk(model, model.joint_q, model.joint_qd, state)
    return state.body_q.numpy()[1, :3]


off = {}
for name, joints in JOINTS.items():
    names = ["first", "second", "knee"] if "second" in joints else ["first", "knee"]
    pose = dict(zip(names, np.linspace(0.3, 0.9, len(names))))
    text = MODEL.format(joints)
    right = with_mujoco(text, pose)
    readers = (with_pinocchio, with_drake, with_newton)
    off[name] = [abs(round(float(np.linalg.norm(read(text, pose) - right)), 2)) for read in readers]
print(f"pin {version('pin')}, drake {version('drake')}, newton {version('newton')}: off by m, in this order: {off}")
expected = {
    "one hinge": [0, 0, 0],
    "one place": [0, 0.3, 0],
    "two places": [0, 0.3, 0.41],
    "oblique axes": [0, 0.3, 0.17],
    "slide last": [0, 0.3, 0.41],
}
if off != expected:
    raise SystemExit("the behaviour has changed")
PYTHON
