#!/bin/sh
# An MJCF person of two links states its mass of 70 kg (`settotalmass`), as one does to fit a person; or its shank has
# a shape that is seen and touches nothing (contype and conaffinity 0), and has mass in MuJoCo like all shapes.
# Guessed: readers that take masses of shapes have 70 kg, and a mass for the shank.
# Measured on 2026-11-29 with mujoco 4.0.0, pin 4.1.0 and drake 1.51.1: Pinocchio leaves settotalmass out in silence,
# and Drake with a warning: 8.4 kg. Pinocchio gives a shape that touches nothing no mass: a shank of 0 kg, in silence.
# newton 1.8.0 leaves settotalmass out in silence, too.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install mujoco==4.0.0 pin==4.1.0 drake==1.51.1 numpy==2.4.6
python -W ignore - 2> log.txt <<'PYTHON' || { cat log.txt >&2; exit 1; }
from importlib.metadata import version

import mujoco
import pinocchio
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

MODEL = """<mujoco model="person">{}<worldbody><body name="thigh"><joint name="hip"/><geom size="0.1"/>
<body name="shank" pos="1 0 0"><joint name="knee"/><geom size="0.1"{}/></body></body></worldbody></mujoco>"""
stated = MODEL.format('<compiler settotalmass="70"/>', "")
seen = MODEL.format("", ' contype="0" conaffinity="0"')


def masses(text):
    """Masses of thigh and shank, kg, in each library."""
    model = mujoco.MjModel.from_xml_string(text)
    with open("person.xml", "w", encoding="utf-8") as file:
        file.write(text)
    pin = pinocchio.buildModelFromMJCF("person.xml")
    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModelsFromString(text, "xml")
    plant.Finalize()
    found = {
        "mujoco": model.body_mass[1:],
        "pin": [inertia.mass for inertia in pin.inertias][1:],
        "drake": [plant.GetBodyByName(name).default_mass() for name in ("thigh", "shank")],
    }
    return {name: [round(float(value), 1) for value in values] for name, values in found.items()}


found = masses(stated), masses(seen)
print(f"pin {version('pin')}, drake {version('drake')}: kg with settotalmass {found[0]}, of seen shapes {found[1]}")
plain = [4.2, 4.2]
if found != (
    {"mujoco": [35, 35], "pin": plain, "drake": plain},
    {"mujoco": plain, "pin": [4.2, 0], "drake": plain},
):
    raise SystemExit("the behaviour has changed")
PYTHON
