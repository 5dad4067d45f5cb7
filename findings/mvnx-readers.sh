#!/bin/sh
# An MVNX file of Xsens has a frame of type tpose, in which the pelvis stands .9 m high, and frames with the angles of
# joints in two orders (jointAngleErgo, jointAngleErgoXZY) before the centre of mass, as newer versions of MVN write
# them.
# Guessed: readers return the T-pose, and the centre of mass.
# Measured on 2026-11-29: mvnx-parser 0.0.5 returns the frame of type identity, at 0, as the T-pose. mvnx 0.2 takes
# elements by their number, so its centre of mass is jointAngleErgoXZY. Neither says so.
. "$(dirname "$0")/common.sh"
install mvnx==0.2 mvnx-parser==0.0.5 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import mvnx
from mvnx_parser import parser

ITEMS = (
    "orientation position velocity acceleration angularVelocity angularAcceleration footContacts "
    "sensorFreeAcceleration sensorMagneticField sensorOrientation jointAngle jointAngleXZY jointAngleErgo "
    "jointAngleErgoXZY centerOfMass"
).split()
VALUES = {"orientation": "1 0 0 0", "position": "0 0 0.95", "jointAngleErgoXZY": "7 8 9", "centerOfMass": "0 0 1.02"}


def frame(kind, items):
    content = "".join(f"<{name}>{value}</{name}>" for name, value in items.items())
    return f'<frame time="0" index="" tc="00:00:00:00" ms="0" type="{kind}">{content}</frame>'


still = [
    frame(kind, {"orientation": "1 0 0 0", "position": f"0 0 {height}"})
    for kind, height in (("identity", 0), ("tpose", 0.9), ("tpose-isb", 0.9))
]
normal = frame("normal", {name: VALUES.get(name, "0 0 0") for name in ITEMS})
Path("take.mvnx").write_text(
    '<?xml version="1.0"?><mvnx version="4"><mvn version="2023.0" build="1"/><comment>none</comment>'
    '<subject label="person" frameRate="60" segmentCount="1" recDate="today" configuration="FullBody" '
    'userScenario="none"><comment/><segments><segment id="1" label="Pelvis"/></segments>'
    '<sensors><sensor label="Pelvis"/></sensors><joints/><ergonomicJointAngles/><footContactDefinition/>'
    f'<frames segmentCount="1" sensorCount="1" jointCount="0">{"".join(still)}{normal}</frames></subject>'
    '<securityCode code="0"/></mvnx>'
)
rest = [float(value) for value in list(parser.Mvnx_p("take.mvnx").tpose.values())[1]]
centre = mvnx.MVNX("take.mvnx").centerOfMass
versions = {name: importlib.metadata.version(name) for name in ("mvnx-parser", "mvnx")}
print(f"{versions}: pelvis of the T-pose {rest}, centre of mass {centre.tolist()}")
if not (rest == [0, 0, 0] and centre.tolist() == [[7, 8, 9]]):
    raise SystemExit("the behaviour has changed")
PYTHON
