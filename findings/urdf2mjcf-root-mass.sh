#!/bin/sh
# A URDF of a body with two links, each with mass and moments of inertia, is converted to MJCF.
# Guessed: masses and moments stay, and the limit of effort limits the motor.
# Measured on 2026-11-27 with urdf2mjcf 0.2.39: the first link loses its <inertial>, so MuJoCo makes its mass of the
# collision shape (8 kg in place of 2 kg); products of inertia are left out, with a warning; the motor has no limit.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install urdf2mjcf==0.2.39 mujoco==4.0.0 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import mujoco
from urdf2mjcf.convert import convert_urdf_to_mjcf

LINK = (
    '<link name="{}"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="2"/>'
    '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.005" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>'
)
JOINT = (
    '<joint name="hip" type="revolute"><parent link="pelvis"/><child link="thigh"/><axis xyz="1 0 0"/>'
    '<limit lower="-1" upper="1" effort="100" velocity="5"/></joint>'
)
source = Path("body.urdf")
source.write_text(f'<robot name="body">{LINK.format("pelvis")}{LINK.format("thigh")}{JOINT}</robot>', encoding="utf-8")
convert_urdf_to_mjcf(source, Path("body.mjcf"))
model = mujoco.MjModel.from_xml_path("body.mjcf")
masses = [float(model.body(name).mass[0]) for name in ("pelvis", "thigh")]
moments = sorted(model.body("thigh").inertia.round(4).tolist())
limited = bool(model.actuator_forcelimited[0]) or bool(model.actuator_ctrllimited[0])
version = importlib.metadata.version("urdf2mjcf")
print(f"urdf2mjcf {version}: masses {masses} kg of 2 and 2 kg, moments {moments}, motor limited: {limited}")
if not (abs(masses[0] - 8) < 1e-6 and abs(masses[1] - 2) < 1e-6 and moments == [0.02, 0.03, 0.04] and not limited):
    raise SystemExit("the behaviour has changed")
PYTHON
