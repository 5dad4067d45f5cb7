#!/bin/sh
# Drake reads a URDF whose link collides as a mesh in STL, as most robots of ROS do, and one whose mesh is OBJ.
# Guessed: both are read, STL perhaps with a warning. Each joint has a limit of effort, and becomes an actuator.
# Measured on 2026-11-27 with drake 1.51.1: STL fails when the plant is finalized; OBJ is read. No actuator is made,
# since the file has no <transmission>.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install drake==1.51.1 trimesh==5.2.0 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import trimesh
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

LINK = (
    '<link name="{}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><mesh filename="{}"/></geometry></collision></link>'
)
JOINT = (
    '<joint name="hip" type="revolute"><parent link="pelvis"/><child link="thigh"/><axis xyz="1 0 0"/>'
    '<limit lower="-1" upper="1" effort="100" velocity="5"/></joint>'
)


def read(suffix):
    trimesh.creation.box().export(f"box{suffix}")
    links = "".join(LINK.format(name, f"box{suffix}") for name in ("pelvis", "thigh"))
    with open("body.urdf", "w", encoding="utf-8") as file:
        file.write(f'<robot name="body">{links}{JOINT}</robot>')
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    try:
        Parser(plant).AddModels("body.urdf")
        plant.Finalize()
    except RuntimeError as failure:
        return "refused" if "unsupported extension" in str(failure) else str(failure)
    return f"{plant.num_actuators()} actuators"


stl = read(".stl")
obj = read(".obj")
print(f"drake {importlib.metadata.version('drake')}: STL {stl}; OBJ {obj}")
if (stl, obj) != ("refused", "0 actuators"):
    raise SystemExit("the behaviour has changed")
PYTHON
