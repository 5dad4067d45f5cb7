#!/bin/sh
# A scene of MuJoCo takes in a model with a free body and a keyframe, at a frame 5 m away.
# Guessed: the keyframe has the body at that place, as the attached model has.
# Measured on 2026-11-28 with mujoco 4.0.0: the keyframe arrives with its prefix, but with the numbers of the child:
# it puts the body back to where it was in its own file, 5 m off.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install mujoco==4.0.0 numpy==2.4.6
python -W ignore - <<'PYTHON'
import mujoco

CHILD = """
<mujoco model="child">
  <worldbody>
    <body name="pelvis" pos="0 0 1">
      <freejoint/>
      <geom type="sphere" size=".1" mass="1"/>
    </body>
  </worldbody>
  <keyframe><key name="photo" qpos="0 0 1 1 0 0 0"/></keyframe>
</mujoco>
"""
scene = mujoco.MjSpec()
scene.attach(mujoco.MjSpec.from_string(CHILD), prefix="a_", frame=scene.worldbody.add_frame(pos=[0, 5, 0]))
model = scene.compile()
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
before = data.body("a_pelvis").xpos.tolist()
mujoco.mj_resetDataKeyframe(model, data, model.key("a_photo").id)
mujoco.mj_forward(model, data)
after = data.body("a_pelvis").xpos.tolist()
print(f"mujoco {mujoco.__version__}: attached at {before}; keyframe {model.key(0).name} puts it at {after}")
if not (before == [0, 5, 1] and after == [0, 0, 1]):
    raise SystemExit("the behaviour has changed")
PYTHON
