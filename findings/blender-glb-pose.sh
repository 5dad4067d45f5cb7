#!/bin/sh
# A skinned GLB is posed by its nodes, without an animation, as people of photos are: the hip stands 2 m aside, and the
# knee is bent by 45 degrees. Blender loads it, and writes it again, each with its defaults.
# Guessed: the foot is in its place in Blender, and in the written file.
# Measured on 2026-11-30 with bpy 5.0.1: in Blender it is. The file has the rest pose, in silence: the hip stands at 0,
# and the knee is straight, so the foot is 2.03 m beside its place. `export_current_frame` does not change it;
# `export_rest_position_armature=False` keeps the pose.
. "$(dirname "$0")/common.sh"
install bpy==5.0.1
python - <<'PYTHON'
import json
import struct

import bpy
import numpy as np

KNEE = [0.3826834, 0, 0, 0.9238795]
JOINTS = [0, 1, 1]
POINTS = np.array([[0, 0, 0], [0, 1, 0], [0, 1.5, 0]], "<f4")
INVERSE_BIND = np.array([np.eye(4), np.eye(4)], "<f4")
INVERSE_BIND[1, 3, 1] = -1  # in columns


def write(path):
    joints = np.array([[joint, 0, 0, 0] for joint in JOINTS], "u1")
    weights = np.array([[1, 0, 0, 0]] * 3, "<f4")
    parts = [part.tobytes() for part in (POINTS, joints, weights, INVERSE_BIND)]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    kinds = [("VEC3", 5126, 3), ("VEC4", 5121, 3), ("VEC4", 5126, 3), ("MAT4", 5126, 2)]
    accessors = [
        {"bufferView": i, "type": kind, "componentType": component, "count": count}
        for i, (kind, component, count) in enumerate(kinds)
    ]
    accessors[0] |= {"min": POINTS.min(0).tolist(), "max": POINTS.max(0).tolist()}
    attributes = {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
        "nodes": [
            {"name": "leg", "mesh": 0, "skin": 0},
            {"name": "hip", "translation": [2, 0, 0], "children": [2]},
            {"name": "knee", "translation": [0, 1, 0], "rotation": KNEE},
        ],
        "meshes": [{"primitives": [{"attributes": attributes}]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 3}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part)}
            for start, part in zip(starts, parts)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    head = json.dumps(document).encode()
    head += b" " * (-len(head) % 4)
    body = struct.pack("<II", len(head), 0x4E4F534A) + head
    body += struct.pack("<II", starts[-1], 0x004E4942) + b"".join(parts)
    with open(path, "wb") as file:
        file.write(struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body)


def nodes(path):
    with open(path, "rb") as file:
        content = file.read()
    size = struct.unpack("<I", content[12:16])[0]
    return {node["name"]: node for node in json.loads(content[20 : 20 + size])["nodes"]}


def written(**options):
    """Place of the hip and turn of the knee in the file that Blender writes."""
    bpy.ops.export_scene.gltf(filepath="back.glb", **options)
    found = nodes("back.glb")
    place = found["hip"].get("translation", [0, 0, 0])
    turn = found["knee"].get("rotation", [0, 0, 0, 1])
    return [np.abs(np.round(values, 3)).tolist() for values in (place, turn)]


write("leg.glb")
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath="leg.glb")
leg = bpy.data.objects["leg"].evaluated_get(bpy.context.evaluated_depsgraph_get())
foot = leg.matrix_world @ leg.to_mesh().vertices[2].co
defaults = written()
frame = written(export_current_frame=True)
posed = written(export_rest_position_armature=False)
place = [round(value, 2) for value in (foot.x, foot.z, -foot.y)]
print(f"bpy {bpy.app.version_string}: foot at {place} in Blender (y up)")
print(f"bpy {bpy.app.version_string}: hip and knee in the file: {defaults}, or {posed}")
if place != [2.0, 1.35, 0.35]:
    raise SystemExit("the behaviour has changed: the foot in Blender")
if not defaults == frame == [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]:
    raise SystemExit("the behaviour has changed: the pose in the file")
if posed != [[2.0, 0.0, 0.0], [0.383, 0.0, 0.0, 0.924]]:
    raise SystemExit("the behaviour has changed: export_rest_position_armature=False")
PYTHON
