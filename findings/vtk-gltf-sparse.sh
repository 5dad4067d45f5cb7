#!/bin/sh
# A valid glTF mesh whose shape (morph target) is a sparse accessor, which leaves out byteOffset, 0 by the
# specification.
# Guessed: VTK, which ParaView, F3D, PyVista and vedo read with, reads the mesh, perhaps without the shape.
# Measured on 2026-11-27 with vtk 9.7.2: it reports "Invalid accessor.sparse.indices.byteOffset value", and returns no
# mesh at all, without an exception. The same shape in a plain accessor is read.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install vtk==9.7.2 numpy==2.4.6
python - <<'PYTHON'
import base64
import json

import numpy as np
import vtk

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
FACES = np.arange(3, dtype="<u2")
STEPS = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1]], "<f4")


def points_read(sparse):
    arrays = [POINTS, np.r_[FACES, np.zeros(1, "<u2")], *([np.array([2, 0], "<u2"), STEPS[2:]] if sparse else [STEPS])]
    content = b"".join(array.tobytes() for array in arrays)
    starts = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
    lengths = [36, 6, 2, 12] if sparse else [36, 6, 36]
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": length}
        for start, length in zip(starts, lengths, strict=False)
    ]
    vector = {"componentType": 5126, "count": 3, "type": "VEC3"}
    shape = {**vector, "min": [0, 0, 0], "max": [0, 0, 1]}
    if sparse:
        indices = {"bufferView": 2, "componentType": 5123}
        shape["sparse"] = {"count": 1, "indices": indices, "values": {"bufferView": 3}}
    else:
        shape["bufferView"] = 2
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "targets": [{"POSITION": 2}]}
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive], "weights": [0.0]}],
        "accessors": [
            {**vector, "bufferView": 0, "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
            shape,
        ],
        "bufferViews": views,
        "buffers": [
            {
                "byteLength": len(content),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(content).decode(),
            }
        ],
    }
    with open("mesh.gltf", "w", encoding="utf-8") as file:
        json.dump(tree, file)
    reader = vtk.vtkGLTFReader()
    reader.SetFileName("mesh.gltf")
    reader.Update()
    return reader.GetOutput().GetNumberOfPoints()


plain = points_read(sparse=False)
sparse = points_read(sparse=True)
print(f"vtk {vtk.VTK_VERSION}: {plain} points with a plain shape, {sparse} with a sparse one")
if (plain, sparse) != (3, 0):
    raise SystemExit("the behaviour has changed")
PYTHON
