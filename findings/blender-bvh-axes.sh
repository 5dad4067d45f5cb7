#!/bin/sh
# Blender reads a BVH file whose skeleton is 1.5 m high along y, and writes it again with the same settings.
# Guessed: the joints come back where they were.
# Measured on 2026-11-28 with bpy 5.0.1: its reader turns y up to z up, its writer turns nothing and has no setting
# for it, so that the file is z up and the person lies on the back for other readers. Frames of 1/30 s become 1/24 s.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install bpy==5.0.1
cat > in.bvh <<'BVH'
HIERARCHY
ROOT Hips
{
	OFFSET 0 0 0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Spine
	{
		OFFSET 0 0.5 0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0 0.1 0
		}
	}
}
MOTION
Frames: 2
Frame Time: 0.0333333
0.3 1 2 0 0 0 0 0 0
0.3 1 2 0 0 0 0 0 0
BVH
python -W ignore - <<'PYTHON'
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_anim.bvh(filepath="in.bvh")
head = bpy.context.object.pose.bones["Hips"].head
bpy.ops.export_anim.bvh(filepath="out.bvh", frame_start=1, frame_end=2)
with open("out.bvh", encoding="utf-8") as file:
    lines = [line.split() for line in file]
offsets = [[float(value) for value in line[1:]] for line in lines if line[:1] == ["OFFSET"]]
time = next(float(line[2]) for line in lines if line[:2] == ["Frame", "Time:"])
spine = [round(value, 4) for value in offsets[1]]
root = [round(float(value), 4) for value in lines[-1][:3]]
place = [round(value, 4) for value in head]
print(f"bpy {bpy.app.version_string}: hips at {place}; written: root {root}, spine {spine}, {time} s")
if not (spine == [0, 0, 0.5] and root == [0.3, -2, 1] and abs(time - 1 / 24) < 1e-4):
    raise SystemExit("the behaviour has changed")
PYTHON
