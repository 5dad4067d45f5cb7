#!/bin/sh
# An MJCF hinge rests at `ref` (30 degrees), so MuJoCo's coordinate of the pose in the file is .524 rad.
# Guessed: another simulator that reads the file has the same coordinate there.
# Measured on 2026-11-27 with newton 1.8.0: its coordinate is 0, and its limits are those of the file less 30 degrees.
# The pose is the same, but coordinates of a keyframe, or of a JSON file, mean another pose there.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install newton==1.8.0 mujoco==4.0.0 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata
import math

import mujoco
import newton

TEXT = """<mujoco><worldbody><body name="shank" pos="0 0 1">
<joint name="knee" type="hinge" axis="0 1 0" range="0 90" ref="30"/>
<geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5"/>
</body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(TEXT)
builder = newton.ModelBuilder()
builder.add_mjcf(TEXT)
coordinate = float(builder.joint_q[0])
upper = math.degrees(float(builder.joint_limit_upper[0]))
version = importlib.metadata.version("newton")
print(f"MuJoCo {mujoco.__version__}: {model.qpos0[0]:.3f} rad; newton {version}: {coordinate:.3f} rad, up to {upper:.0f} degrees")
if not (abs(model.qpos0[0] - math.pi / 6) < 1e-6 and coordinate == 0.0 and abs(upper - 60) < 1e-3):
    raise SystemExit("the behaviour has changed")
PYTHON
