#!/bin/sh
# In the URDF of a hand, the tip of a finger follows its middle joint: <mimic> with a factor of .5 and .2 rad more.
# yourdfpy, which obeys that, reads the file, and writes it again.
# Guessed: <mimic> is written; what yourdfpy has no use for, such as <transmission>, perhaps is not.
# Measured on 2026-11-29 with yourdfpy 0.0.60 and urchin 0.0.30: <mimic> is left out in silence, and so are
# <transmission> and <safety_controller>, so the tip stays straight, and the hand has one free joint more. urchin
# writes all three.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install yourdfpy==0.0.60 urchin==0.0.30 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import urchin
import yourdfpy

JOINT = '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><axis xyz="1 0 0"/>{}</joint>'
LIMIT = '<limit lower="0" upper="2" effort="1" velocity="1"/>'
SAFETY = '<safety_controller k_velocity="1" soft_lower_limit="0.1" soft_upper_limit="1.9"/>'
links = "".join(f'<link name="{name}"/>' for name in ("palm", "middle", "tip"))
middle = JOINT.format("bend", "palm", "middle", LIMIT + SAFETY)
tip = JOINT.format("follow", "middle", "tip", LIMIT + '<mimic joint="bend" multiplier="0.5" offset="0.2"/>')
motor = """<transmission name="motor"><type>transmission_interface/SimpleTransmission</type><joint name="bend">
<hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface></joint>
<actuator name="one"/></transmission>"""
Path("hand.urdf").write_text(f'<robot name="hand">{links}{middle}{tip}{motor}</robot>')

hand = yourdfpy.URDF.load("hand.urdf")
hand.write_xml_file("yourdfpy.urdf")
urchin.URDF.load("hand.urdf").save("urchin.urdf")
again = yourdfpy.URDF.load("yourdfpy.urdf")
free = [robot.actuated_joint_names for robot in (hand, again)]
kept = {
    name: [part for part in ("mimic", "transmission", "safety_controller") if f"<{part}" in Path(name).read_text()]
    for name in ("yourdfpy.urdf", "urchin.urdf")
}
print(f"yourdfpy {version('yourdfpy')}, urchin {version('urchin')}: kept {kept}; free joints before and after: {free}")
parts = ["mimic", "transmission", "safety_controller"]
if kept != {"yourdfpy.urdf": [], "urchin.urdf": parts} or free != [["bend"], ["bend", "follow"]]:
    raise SystemExit("the behaviour has changed")
PYTHON
