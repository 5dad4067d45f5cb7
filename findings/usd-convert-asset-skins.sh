#!/bin/sh
# A glTF file has two skinned triangles, each with a skeleton of its own; that of person_1 stands 10 m beside the
# other.
# Guessed: NVIDIA's converter writes two skeletons to USD.
# Measured on 2026-11-28 with usd-convert-asset 1.1.0: it binds both to the first, so person_1 stands where person_0
# stands, in silence, whatever the names of the joints. It also writes centimetres. Its wheel needs Python 3.12, in
# PATH or of pyenv.
# Readers guessed: right, right, wrong.
. "$(dirname "$0")/common.sh"
python=python3.12
"$python" --version > /dev/null 2>&1 || python="$(pyenv prefix 3.12)/bin/python3.12"
"$python" -m venv "$folder/venv"
install usd-convert-asset==1.1.0 usd-core==26.11
cat > make.py <<'PYTHON'
import base64
import json
import struct

identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
parts = [
    struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0),
    bytes(12),
    struct.pack("<12f", *([1, 0, 0, 0] * 3)),
    struct.pack("<16f", *identity),
]
views = []
for part in parts:
    start = sum(view["byteLength"] for view in views)
    views.append({"buffer": 0, "byteOffset": start, "byteLength": len(part)})
data = b"".join(parts)
shapes = [(5126, 3, "VEC3"), (5121, 3, "VEC4"), (5126, 3, "VEC4"), (5126, 1, "MAT4")]
accessors = [
    {"bufferView": number, "componentType": kind, "count": count, "type": shape}
    for number, (kind, count, shape) in enumerate(shapes)
]
accessors[0].update({"min": [0, 0, 0], "max": [1, 1, 0]})
nodes = []
skins = []
for person in (0, 1):
    first = len(nodes)
    nodes.append({"name": f"skeleton_{person}", "children": [first + 1]})
    nodes.append({"name": f"pelvis_{person}", "translation": [10 * person, 0, 0]})
    nodes.append({"name": f"person_{person}", "mesh": person, "skin": person})
    skins.append({"joints": [first + 1], "inverseBindMatrices": 3, "skeleton": first})
primitive = {"attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}}
document = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 2, 3, 5]}],
    "nodes": nodes,
    "skins": skins,
    "meshes": [{"name": f"person_{person}", "primitives": [primitive]} for person in (0, 1)],
    "accessors": accessors,
    "bufferViews": views,
    "buffers": [
        {"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
    ],
}
with open("people.gltf", "w", encoding="utf-8") as file:
    json.dump(document, file)
PYTHON
python make.py
"$folder/venv/bin/usd-convert-asset" -i people.gltf -o people.usdc > convert.log 2>&1
python - <<'PYTHON'
import importlib.metadata

from pxr import Usd, UsdGeom, UsdSkel

stage = Usd.Stage.Open("people.usdc")
skeletons = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Skeleton)]
bound = {}
for prim in stage.Traverse():
    if prim.IsA(UsdGeom.Mesh):
        targets = UsdSkel.BindingAPI(prim).GetSkeletonRel().GetTargets()
        bound[prim.GetName()] = [str(target) for target in targets]
unit = UsdGeom.GetStageMetersPerUnit(stage)
version = importlib.metadata.version("usd-convert-asset")
print(f"usd-convert-asset {version}: {len(skeletons)} skeleton, metersPerUnit {unit}, {bound}")
shared = set(bound) == {"person_0", "person_1"} and bound["person_0"] == bound["person_1"] != []
if not (len(skeletons) == 1 and shared and unit == 0.01):
    raise SystemExit("the behaviour has changed")
PYTHON
