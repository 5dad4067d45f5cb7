#!/bin/sh
# A URDF of a leg leaves the <axis> of a hip out, which is 1 0 0 then, by the format. Eight libraries make a chain of
# it.
# Guessed: ikpy has no joint there, and the others turn about x.
# Measured on 2026-11-29 with ikpy 4.2.1, kinpy 0.6.1, mujoco 4.0.0, pin 4.1.0, pybullet 3.2.7, scikit-robot 0.4.7,
# urchin 0.0.30 and yourdfpy 0.0.60, and once with drake 1.51.1, newton 1.8.0 and sapien 3.0.3: kinpy alone turns
# about z, in silence: the foot of a leg of 2 m is 2.1 m beside its place.
# Readers guessed: right, in part, right.
. "$(dirname "$0")/common.sh"
install kinpy==0.6.1 ikpy==4.2.1 urchin==0.0.30 yourdfpy==0.0.60 mujoco==4.0.0 pin==4.1.0 pybullet==3.2.7 \
    scikit-robot==0.4.7 numpy==2.4.6
python -W ignore - 2> log.txt <<'PYTHON' || { cat log.txt >&2; exit 1; }
from importlib.metadata import version

import numpy as np

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LINK = f'<link name="{{}}"><inertial><mass value="1"/>{INERTIA}</inertial></link>'
LIMIT = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>{}</joint>'
joints = [
    ("hip", "revolute", "base", "thigh", 0, LIMIT),
    ("knee", "revolute", "thigh", "shank", 1, f'<axis xyz="0 0 1"/>{LIMIT}'),
    ("ankle", "fixed", "shank", "foot", 1, ""),
]
links = "".join(LINK.format(name) for name in ("base", "thigh", "shank", "foot"))
text = f'<robot name="leg">{links}{"".join(JOINT.format(*joint) for joint in joints)}</robot>'
with open("leg.urdf", "w", encoding="utf-8") as file:
    file.write(text)
POSE = {"hip": 1.0, "knee": 0.5}


def with_kinpy():
    import kinpy

    return kinpy.build_chain_from_urdf(text).forward_kinematics(POSE)["foot"].pos


def with_ikpy():
    from ikpy.chain import Chain

    chain = Chain.from_urdf_file("leg.urdf", base_elements=["base"])
    return chain.forward_kinematics([POSE.get(link.name, 0.0) for link in chain.links])[:3, 3]


def with_urchin():
    import urchin

    return urchin.URDF.load("leg.urdf").link_fk(cfg=POSE, link="foot")[:3, 3]


def with_yourdfpy():
    import yourdfpy

    robot = yourdfpy.URDF.load("leg.urdf", load_meshes=False)
    robot.update_cfg(POSE)
    return robot.get_transform("foot", "base")[:3, 3]


def with_mujoco():
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        text.replace('name="leg">', 'name="leg"><mujoco><compiler fusestatic="false"/></mujoco>', 1)
    )
    data = mujoco.MjData(model)
    data.qpos[:] = list(POSE.values())
    mujoco.mj_forward(model, data)
    return data.body("foot").xpos


def with_pin():
    import pinocchio

    model = pinocchio.buildModelFromUrdf("leg.urdf")
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array(list(POSE.values())))
    return data.oMf[model.getFrameId("foot")].translation


def with_pybullet():
    import pybullet

    pybullet.connect(pybullet.DIRECT)
    leg = pybullet.loadURDF("leg.urdf", useFixedBase=True)
    for number, angle in enumerate(POSE.values()):
        pybullet.resetJointState(leg, number, angle)
    return pybullet.getLinkState(leg, 2, computeForwardKinematics=True)[4]


def with_scikit_robot():
    from skrobot.models.urdf import RobotModelFromURDF

    robot = RobotModelFromURDF(urdf_file="leg.urdf")
    for name, angle in POSE.items():
        getattr(robot, name).joint_angle(angle)
    return robot.foot.worldpos()


right = [1 + np.cos(0.5), np.sin(0.5) * np.cos(1), np.sin(0.5) * np.sin(1)]
readers = {name[5:]: read for name, read in list(globals().items()) if name.startswith("with_")}
off = {name: round(float(np.linalg.norm(np.array(read()) - right)), 2) for name, read in readers.items()}
print(f"kinpy {version('kinpy')}: the foot of each library beside its place, m: {off}")
if {name: value for name, value in off.items() if value} != {"kinpy": 2.06}:
    raise SystemExit("the behaviour has changed")
PYTHON
