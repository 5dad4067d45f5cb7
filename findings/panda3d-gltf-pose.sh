#!/bin/sh
# A skinned glTF mesh is posed: its one joint stands 2 m aside of its bind pose, in the nodes of the file, as a person of
# a photo is posed. A second file has an attribute of its own (_CONTACT), too, as glTF allows. Panda3D loads both by
# panda3d-gltf.
# Guessed: the mesh is 2 m aside, as in Blender, VTK, Babylon.js and three.js, with or without the attribute.
# Measured on 2026-11-29 with panda3d 1.10.16, panda3d-gltf 1.3.0 and vtk 9.7.2: Panda3D has it at 0, in silence: the
# joint's pose is made of the inverse bind matrix alone, so a person stands in the bind pose unless an animation is
# played. VTK has it at 2 m. The second file ends with an AttributeError, since the attribute's name begins with _.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install panda3d==1.10.16 panda3d-gltf==1.3.0 vtk==9.7.2 numpy==2.4.6
python -W ignore - 2> log.txt <<'PYTHON' || { cat log.txt >&2; exit 1; }
import base64
import json
from importlib.metadata import version

import gltf
import numpy as np
import vtk
from panda3d.core import GeomVertexReader, NodePath, Thread

parts = [
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4"),
    np.zeros((3, 4), "u1"),
    np.eye(4, dtype="<f4")[[0, 0, 0]],
    np.eye(4, dtype="<f4"),
    np.array([0, 1, 2, 0], "<u2"),
    np.ones(3, "<f4"),
]
kinds = [(5126, "VEC3", 3), (5121, "VEC4", 3), (5126, "VEC4", 3), (5126, "MAT4", 1), (5123, "SCALAR", 3)]
kinds += [(5126, "SCALAR", 3)]
starts = np.cumsum([0] + [part.nbytes for part in parts]).tolist()
accessors = [
    {"bufferView": number, "componentType": kind, "type": shape, "count": count}
    for number, (kind, shape, count) in enumerate(kinds)
]
accessors[0] |= {"min": [0, 0, 0], "max": [1, 1, 0]}
data = base64.b64encode(b"".join(part.tobytes() for part in parts)).decode()
attributes = {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}
document = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 1]}],
    "nodes": [{"name": "body", "mesh": 0, "skin": 0}, {"name": "hip", "translation": [2, 0, 0]}],
    "skins": [{"joints": [1], "inverseBindMatrices": 3}],
    "meshes": [{"primitives": [{"attributes": attributes, "indices": 4, "material": 0}]}],
    "materials": [{"name": "skin"}],
    "accessors": accessors,
    "bufferViews": [
        {"buffer": 0, "byteOffset": start, "byteLength": part.nbytes} for start, part in zip(starts, parts)
    ],
    "buffers": [{"byteLength": starts[-1], "uri": f"data:application/octet-stream;base64,{data}"}],
}
with open("person.gltf", "w", encoding="utf-8") as file:
    json.dump(document, file)
attributes["_CONTACT"] = 5
with open("own.gltf", "w", encoding="utf-8") as file:
    json.dump(document, file)

root = NodePath(gltf.load_model("person.gltf"))
root.find("**/+Character").node().force_update()
geometry = root.find("**/+GeomNode").node().get_geom(0).get_vertex_data()
panda = GeomVertexReader(geometry.animate_vertices(True, Thread.get_current_thread()), "vertex").get_data3()[0]
reader = vtk.vtkGLTFReader()
reader.SetFileName("person.gltf")
reader.Update()
parts = reader.GetOutput().NewIterator()
parts.InitTraversal()
other = parts.GetCurrentDataObject().GetPoint(0)[0]
refused = ""
try:
    gltf.load_model("own.gltf")
except AttributeError as error:
    refused = str(error)
print(f"panda3d-gltf {version('panda3d-gltf')}: a vertex at x = {panda} m, VTK {other} m; own attribute: {refused}")
if (panda, other) != (0, 2) or "basename" not in refused:
    raise SystemExit("the behaviour has changed")
PYTHON
