#!/bin/sh
# dm_control attaches a person, whose MJCF states its angles in radians, to a scene that leaves the unit out (degrees,
# by the format).
# Guessed: the ranges of all joints keep their angles, or the library refuses two units.
# Measured on 2026-11-28 with dm_control 1.0.50: the scene takes over angle="radian", and its numbers stay: the door's
# limit of 90 degrees is 90 rad, 14 turns, in silence. A scene that states "degree" is refused.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install dm_control==1.0.50 mujoco==4.0.0 numpy==2.4.6
MUJOCO_GL=disable python -W ignore - <<'PYTHON'
import importlib.metadata

import mujoco
import numpy as np
from dm_control import mjcf

JOINT = '<joint name="{0}" axis="0 0 1" range="{1}" limited="true"/>'
BODY = f'<body name="{{0}}">{JOINT}<geom size="0.1"/></body>'
SCENE = '<mujoco model="scene">{}<worldbody>' + BODY.format("door", "-90 90") + "</worldbody></mujoco>"
PERSON = SCENE.replace("door", "knee").replace("-90 90", "0 2").replace("scene", "person")
PERSON = PERSON.format('<compiler angle="radian"/>')


def limit(text):
    model = mujoco.MjModel.from_xml_string(text)
    return float(np.degrees(model.joint("door").range[1]))


alone = limit(SCENE.format(""))
scene = mjcf.from_xml_string(SCENE.format(""))
scene.attach(mjcf.from_xml_string(PERSON))
attached = limit(scene.to_xml_string())
refused = False
try:
    mjcf.from_xml_string(SCENE.format('<compiler angle="degree"/>')).attach(mjcf.from_xml_string(PERSON))
except ValueError:
    refused = True
version = importlib.metadata.version("dm_control")
print(f"dm_control {version}: the door ends at {alone:.0f}, then {attached:.0f} degrees; stated, refused: {refused}")
if not (abs(alone - 90) < 1e-3 and abs(attached - np.degrees(90)) < 1 and refused):
    raise SystemExit("the behaviour has changed")
PYTHON
