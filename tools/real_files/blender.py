"""Make the rendered depth of the tests anew: a plane 3 m below the camera, with nothing around it.

python -m venv venv
venv/bin/pip install bpy==5.0.1
venv/bin/python tools/real_files/blender.py plugins/embedded/tests/opencv/exr
"""

from __future__ import annotations

import sys
from pathlib import Path


def render(path: Path) -> None:
    """Write the passes of one render as Blender 5 does: one part of the EXR file for each pass."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 0, 0))
    bpy.ops.object.camera_add(location=(0, 0, 3))
    scene.camera = bpy.context.object
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 1
    scene.render.resolution_x = 64
    scene.render.resolution_y = 48
    scene.view_layers[0].use_pass_z = True
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth = "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    render(Path(sys.argv[1]).resolve() / "blender5_parts.exr")
