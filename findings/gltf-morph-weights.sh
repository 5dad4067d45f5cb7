#!/bin/sh
# A glTF body is made by a morph target, as shapes and faces of body models are: the file states its weight, 1, and the
# target moves the mesh by 5 m along z. Where is the mesh for readers that show meshes in Python?
# Guessed: trimesh and Open3D leave the target out; PyVista either has it in both of its readers or in neither.
# Measured on 2026-12-01 with trimesh 5.2.0, Open3D 0.20.0 and PyVista 0.49.1 (VTK 9.7.2): z is 0 in trimesh and Open3D,
# and 5 in `pyvista.read`, but `Plotter.import_gltf` of the same PyVista shows the mesh at 0. None says a word.
# Readers guessed: wrong, wrong for `import_gltf`, wrong.
. "$(dirname "$0")/common.sh"
install trimesh==5.2.0 open3d==0.20.0 pyvista==0.49.1 vtk==9.7.2 numpy==2.4.6
python - 2> log.txt <<'PYTHON' || { tail -n 3 log.txt; exit 1; }
import base64
import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import open3d
import pyvista
import trimesh

points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
shift = np.tile(np.float32([0, 0, 5]), (3, 1))
content = points.tobytes() + shift.tobytes() + np.arange(3, dtype=np.uint32).tobytes()
primitive = {"attributes": {"POSITION": 0}, "indices": 2, "targets": [{"POSITION": 1}]}
model = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [primitive], "weights": [1.0]}],
    "buffers": [
        {
            "byteLength": len(content),
            "uri": "data:application/octet-stream;base64," + base64.b64encode(content).decode(),
        }
    ],
    "bufferViews": [
        {"buffer": 0, "byteOffset": start, "byteLength": size} for start, size in ((0, 36), (36, 36), (72, 12))
    ],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
        {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 5], "max": [0, 0, 5]},
        {"bufferView": 2, "componentType": 5125, "count": 3, "type": "SCALAR"},
    ],
}
Path("body.gltf").write_text(json.dumps(model))


def middle_column(plotter: pyvista.Plotter) -> float:
    """The middle of what is drawn, from 0 to 1, seen from aside, so that z grows to the right."""
    plotter.set_background("white")
    plotter.camera.position, plotter.camera.focal_point = (-20, 0.5, 22.5), (0, 0.5, 2.5)
    plotter.camera.up = (0, 1, 0)
    plotter.camera.parallel_projection, plotter.camera.parallel_scale = True, 5
    picture = plotter.screenshot(None, return_img=True)
    return float(np.nonzero(picture.min(axis=2) < 240)[1].mean() / picture.shape[1])


imported = pyvista.Plotter(off_screen=True, window_size=(200, 200))
imported.import_gltf("body.gltf", set_camera=False)
read = pyvista.Plotter(off_screen=True, window_size=(200, 200))
read.add_mesh(pyvista.read("body.gltf").combine())
z = {
    "trimesh": float(trimesh.load_scene("body.gltf").to_geometry().vertices[0, 2]),
    "open3d": float(np.asarray(open3d.io.read_triangle_mesh("body.gltf").vertices)[0, 2]),
    "pyvista.read": float(pyvista.read("body.gltf").combine().points[0, 2]),
}
left, right = middle_column(imported), middle_column(read)
versions = ", ".join(f"{name} {version(name)}" for name in ("trimesh", "open3d", "pyvista", "vtk"))
print(f"{versions}: z {z}; middle of the picture: import_gltf {left:.2f}, read {right:.2f}")
if z != {"trimesh": 0.0, "open3d": 0.0, "pyvista.read": 5.0} or not left < 0.4 < 0.6 < right:
    raise SystemExit("the behaviour has changed")
PYTHON
