"""The documented way to FBX, by Blender: read back, the file holds the objects of the result."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from physic_core import Reconstruction
from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import export_frame

READ_BACK = """
import bpy, json
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.fbx(filepath='skinned.fbx')
bpy.context.view_layer.update()
graph, found = bpy.context.evaluated_depsgraph_get(), {}
for thing in bpy.data.objects:
    entry = found[thing.name] = {'kind': thing.type}
    if thing.type == 'MESH':
        mesh, turn = thing.evaluated_get(graph).to_mesh(), thing.matrix_world
        points = [turn @ vertex.co for vertex in mesh.vertices]
        entry['low'] = [min(point[axis] for point in points) for axis in range(3)]
        entry['high'] = [max(point[axis] for point in points) for axis in range(3)]
json.dump(found, open('found.json', 'w'))
"""


@pytest.mark.skipif(find_spec("bpy") is None, reason="needs `pip install bpy`")
def test_the_fbx_of_the_documented_command_holds_the_objects_of_the_result(
    saved_pair: Path, result: Reconstruction, repository: Path, tmp_path: Path
):
    shutil.copy(saved_pair / "combined.glb", tmp_path / "skinned.glb")
    text = (repository / "docs" / "exports.md").read_text()
    (convert,) = re.findall(r'blender --background --python-expr "(.*?)"\n', text, re.S)
    for script in (convert, READ_BACK):
        command = [sys.executable, "-c", script]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    found = json.loads((tmp_path / "found.json").read_text())
    assert {name: entry["kind"] for name, entry in found.items()} == {
        "scene": "MESH",
        "floor": "MESH",
        "person_0": "MESH",
        "person_1": "MESH",
        "person_0_skeleton": "ARMATURE",
        "person_1_skeleton": "ARMATURE",
        "camera": "CAMERA",
    }
    matrix = export_frame(result.scene.floor, "z").from_camera
    for index, person in enumerate(result.people):
        posed = transform_points(matrix, person.vertices)
        np.testing.assert_allclose(found[f"person_{index}"]["low"], posed.min(0), atol=1e-4)
        np.testing.assert_allclose(found[f"person_{index}"]["high"], posed.max(0), atol=1e-4)
