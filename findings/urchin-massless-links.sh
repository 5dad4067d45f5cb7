#!/bin/sh
# A URDF has a body of 2 kg, and a link without <inertial> that only names a place, as frames of cameras and tips of
# fingers are.
# Guessed: a library reads it, and writes it again, without a mass.
# Measured on 2026-11-28 with urchin 0.0.30: it gives the link 1 kg and moments of inertia of 1 kg m2, and writes
# them, in silence. yourdfpy 0.0.60 leaves the link as it is.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install urchin==0.0.30 yourdfpy==0.0.60 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata
import os
import xml.etree.ElementTree as xml

import urchin
import yourdfpy

INERTIAL = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINT = '<joint name="tip" type="fixed"><parent link="hand"/><child link="tip"/></joint>'
with open("hand.urdf", "w", encoding="utf-8") as file:
    file.write(f'<robot name="hand"><link name="hand">{INERTIAL}</link><link name="tip"/>{JOINT}</robot>')
os.mkdir("made")
urchin.URDF.load("hand.urdf").save("made/urchin.urdf")
yourdfpy.URDF.load("hand.urdf").write_xml_file("made/yourdfpy.urdf")
mass = {}
for name in ("urchin", "yourdfpy"):
    mass[name] = sum(float(element.get("value")) for element in xml.parse(f"made/{name}.urdf").iter("mass"))
versions = [importlib.metadata.version(name) for name in mass]
print(f"2 kg in the file; urchin {versions[0]} and yourdfpy {versions[1]} write {mass}")
if mass != {"urchin": 3, "yourdfpy": 2}:
    raise SystemExit("the behaviour has changed")
PYTHON
