"""Draw the exports of the demo photo as other programs read them: ``docs/pictures/export-*.png``.

    make export-pictures                       # or: make export-pictures RESULT=out
    .venv-bpy/bin/python tools/export_pictures.py [RESULT]

RESULT is the folder of a result; without it, ``examples/couple.jpg`` is reconstructed. The
``physic`` command of ``.venv`` writes the files. What draws them did not write them and imports
nothing of PhySIC: Blender (``bpy``) with Cycles on the processor, and MuJoCo, which needs EGL or
OSMesa (``MUJOCO_GL``).
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import bpy
import mujoco
import numpy as np
from mathutils import Vector
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
Point = tuple[float, float, float]
PICTURES = ROOT / "docs" / "pictures"
PHYSIC = ROOT / ".venv" / "bin" / "physic"
PHOTO = ROOT / "examples" / "couple.jpg"
WIDTH = 640
HEIGHT = 480
SAMPLES = 48
"""Light paths a pixel; what noise is left, Cycles removes."""
EYE = (2.6, 0.3, 1.9)
TARGET = (0.1, 3.6, 0.75)
FIELD_OF_VIEW = 0.75
"""Metres with z up, as Blender has them after each import, and radians across."""
FAR_EYE = (1.2, -3.8, 2.4)
FAR_TARGET = (0.3, 9.0, 1.0)
"""A view of the farther points, too."""
POINT_M = 0.015
"""Radius of a point of the PLY: about one pixel at the distance of the farther points."""


def export(result: Path, folder: Path, form: str) -> list[Path]:
    """Write one format to a folder of its own, and return its files."""
    folder = folder / form
    folder.mkdir()
    subprocess.run([PHYSIC, "export", result, "--to", form, "-o", f"{folder}/"], check=True)
    return sorted(folder.iterdir())


def save(name: str, picture: Image.Image) -> None:
    file = PICTURES / f"export-{name}.png"
    picture.convert("RGB").quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(
        file, optimize=True
    )
    print(file.name, file.stat().st_size // 1024, "KB", flush=True)


def use_vertex_colors() -> None:
    """Let what has no material have the colours of its vertices, as Blender's viewport can show
    them.
    """
    for shape in (*bpy.data.meshes, *bpy.data.pointclouds):
        if not shape.materials and shape.color_attributes:
            material = bpy.data.materials.new(shape.name)
            nodes = material.node_tree.nodes
            links = material.node_tree.links
            colors = nodes.new("ShaderNodeAttribute")
            colors.attribute_name = shape.color_attributes[0].name
            links.new(colors.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
            nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.8
            shape.materials.append(material)


def render(name: str, eye: Point = EYE, target: Point = TARGET) -> None:
    """Render what is imported, from a place beside the photo's camera."""
    use_vertex_colors()
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("sky")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.53, 0.58, 1)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = 2.0
    sun.data.angle = 0.1
    sun.rotation_euler = (0.7, 0.3, 0.0)
    camera = bpy.data.objects.new("view", bpy.data.cameras.new("view"))
    camera.data.angle = FIELD_OF_VIEW
    camera.location = eye
    camera.rotation_euler = (Vector(target) - Vector(eye)).to_track_quat("-Z", "Y").to_euler()
    for thing in (sun, camera):
        scene.collection.objects.link(thing)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_denoising = True
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = WIDTH
    scene.render.resolution_y = HEIGHT
    scene.render.resolution_percentage = 100
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = f"{folder}/picture.png"
        bpy.ops.render.render(write_still=True)
        save(name, Image.open(scene.render.filepath))


def draw_glb(files: list[Path]) -> None:
    bpy.ops.import_scene.gltf(filepath=str(files[0]), disable_bone_shape=True)
    render("glb")


def draw_usd(files: list[Path]) -> None:
    bpy.ops.wm.usd_import(filepath=str(files[0]))
    render("usd")


def draw_ply(files: list[Path]) -> None:
    bpy.ops.wm.ply_import(filepath=str(files[0]), forward_axis="NEGATIVE_Z", up_axis="Y")
    bpy.ops.object.duplicate()
    # the mesh stays; its copy shows the points without faces, too
    bpy.ops.object.convert(target="POINTCLOUD")
    points = bpy.context.object.data
    of = np.empty(len(points.points), np.float32)
    points.attributes["object"].data.foreach_get("value", of)
    radii = points.attributes.new("radius", "FLOAT", "POINT")
    radii.data.foreach_set("value", np.where(of < 0, POINT_M, 0).astype(np.float32))
    render("ply", FAR_EYE, FAR_TARGET)


def draw_obj(files: list[Path]) -> None:
    bpy.ops.wm.obj_import(filepath=str(files[0]))
    render("obj")


def draw_bvh(files: list[Path]) -> None:
    """Cycles renders no armatures: a cone stands for each bone, from its head to its tail."""
    blue = bpy.data.materials.new("bone")
    blue.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.03, 0.2, 0.6, 1)
    for file in files:
        bpy.ops.import_anim.bvh(filepath=str(file))
        armature = bpy.context.object
        for bone in armature.pose.bones:
            head = armature.matrix_world @ bone.head
            tail = armature.matrix_world @ bone.tail
            length = (tail - head).length
            turn = (tail - head).to_track_quat("Z", "Y").to_euler()
            bpy.ops.mesh.primitive_cone_add(
                vertices=12,
                radius1=0.12 * length,
                depth=length,
                location=(head + tail) / 2,
                rotation=turn,
            )
            bpy.context.object.data.materials.append(blue)
    bpy.ops.mesh.primitive_plane_add(size=8, location=(0, 3.6, 0))
    render("bvh")


def draw_mjcf(files: list[Path]) -> None:
    """Show the shapes that collide, in the pose of the file."""
    spec = mujoco.MjSpec.from_file(str(files[0]))
    sky = {"type": mujoco.mjtTexture.mjTEXTURE_SKYBOX, "builtin": mujoco.mjtBuiltin.mjBUILTIN_FLAT}
    spec.add_texture(
        name="sky", rgb1=[0.74, 0.76, 0.79], rgb2=[0.74, 0.76, 0.79], width=64, height=64 * 6, **sky
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    options = mujoco.MjvOption()
    away = np.subtract(TARGET, EYE)
    camera.lookat, camera.distance = TARGET, np.linalg.norm(away)
    camera.azimuth = np.degrees(np.arctan2(away[1], away[0]))
    camera.elevation = np.degrees(np.arcsin(away[2] / camera.distance))
    model.vis.global_.fovy = np.degrees(2 * np.arctan(np.tan(FIELD_OF_VIEW / 2) * HEIGHT / WIDTH))
    options.geomgroup[2], options.geomgroup[3] = 0, 1
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data, camera, options)
        save("mjcf", Image.fromarray(renderer.render()))


DRAWN = {
    "glb": draw_glb,
    "bvh": draw_bvh,
    "ply": draw_ply,
    "obj": draw_obj,
    "usd": draw_usd,
    "mjcf": draw_mjcf,
}


def main() -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        result = Path(sys.argv[1]) if sys.argv[1:] else folder / "result"
        if not sys.argv[1:]:
            subprocess.run([PHYSIC, "run", PHOTO, "-o", result], check=True)
        for form, draw in DRAWN.items():
            bpy.ops.wm.read_factory_settings(use_empty=True)
            draw(export(result, folder, form))


if __name__ == "__main__":
    main()
