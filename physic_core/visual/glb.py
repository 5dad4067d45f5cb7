"""Export a reconstruction to GLB files in metres, y up.

Points are transformed by :func:`physic_core.geometry.upright.gltf_from_camera`; each file has this matrix in its
``extras``. The scene is textured with the photo without people. It is unlit, since a photo contains its own lighting.
People are matte and lit by the viewer; contact vertices have the colour of what they touch.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.geometry.upright import gltf_from_camera, transform_points
from physic_core.visual.contact_colors import contact_colors
from physic_core.visual.surface import SceneMesh, depth_limit, mesh_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Person, Reconstruction, UInt8Array

__all__ = ["glb_files"]

_SCENE_MATERIAL = {
    "name": "photo",
    "doubleSided": True,
    "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0},
    "extensions": {"KHR_materials_unlit": {}},
}
_BODY_MATERIAL = {
    "name": "mannequin",
    "doubleSided": False,
    "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9},
}


def glb_files(reconstruction: Reconstruction, *, parts: bool = True) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of ``scene.glb``, ``person_0.glb``, ... if ``parts``, and of ``combined.glb``.

    The file of a person without a body is empty, since glTF does not support NaN.
    """
    matrix = gltf_from_camera(reconstruction.scene.floor)
    surface = mesh_scene(reconstruction.scene, depth_limit(reconstruction))
    texture = _jpeg(reconstruction.scene.colors)
    scene = {"scene": _scene_mesh(surface, reconstruction.scene.valid.shape, matrix)} if len(surface.faces) else {}
    people = {
        f"person_{index}": _person_mesh(person, reconstruction, matrix)
        for index, person in enumerate(reconstruction.people)
        if np.isfinite(person.vertices).all()
    }
    extras = {
        "units": "metres",
        "axes": "x right, y up, z backward",
        "gltf_from_camera": matrix.tolist(),
        "camera": "OpenCV: x right, y down, z forward",
        "body_model": reconstruction.body_model,
    }
    if parts:
        yield "scene.glb", _export(scene, texture, extras)
        for name in (f"person_{index}" for index in range(len(reconstruction.people))):
            yield f"{name}.glb", _export({name: people[name]} if name in people else {}, None, extras)
    yield "combined.glb", _export(scene | people, texture, extras)


def _scene_mesh(surface: SceneMesh, shape: tuple[int, ...], matrix: NDArray[np.float64]) -> Any:
    import trimesh

    height, width = shape
    # trimesh turns v over when it writes: glTF counts it from the top, as pixels do.
    uv = np.stack([(surface.pixels[:, 0] + 0.5) / width, 1.0 - (surface.pixels[:, 1] + 0.5) / height], -1)
    # A material of its own keeps trimesh from adding its default picture; the real one is put in by _export.
    visual = trimesh.visual.TextureVisuals(uv=uv, material=trimesh.visual.material.PBRMaterial(name="photo"))
    vertices = transform_points(matrix, surface.vertices)
    return trimesh.Trimesh(vertices, surface.faces, visual=visual, process=False)


def _person_mesh(person: Person, reconstruction: Reconstruction, matrix: NDArray[np.float64]) -> Any:
    import trimesh

    colors = np.full((len(person.vertices), 4), 255, np.uint8)
    colors[:, :3] = _linear(contact_colors(person, reconstruction.contact_partners))
    vertices = transform_points(matrix, person.vertices)
    mesh = trimesh.Trimesh(vertices, reconstruction.faces, vertex_colors=colors, process=False)
    _ = mesh.vertex_normals  # smooth shading: the exporter writes normals that are already there
    return mesh


def _linear(rgb: UInt8Array) -> UInt8Array:
    """Convert sRGB 0-255 to linear 0-255 for glTF vertex colours."""
    share = rgb / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.round(linear * 255).astype(np.uint8)


def _jpeg(image: UInt8Array) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=90)
    return buffer.getvalue()


def _export(meshes: dict[str, Any], texture: bytes | None, extras: dict[str, Any]) -> bytes:
    import trimesh

    scene = trimesh.Scene(base_frame="physic")
    for name, mesh in meshes.items():
        scene.add_geometry(mesh, node_name=name, geom_name=name)

    def add_materials(buffers: Any, tree: dict[str, Any]) -> None:
        """Add materials and texture to the glTF tree; trimesh has no unlit material and re-encodes images."""
        tree["materials"] = [_SCENE_MATERIAL, _BODY_MATERIAL] if texture else [_BODY_MATERIAL]
        for mesh in tree["meshes"]:
            for primitive in mesh["primitives"]:
                primitive["material"] = 0 if texture and mesh["name"] == "scene" else len(tree["materials"]) - 1
        tree["scenes"][0]["extras"] = extras
        tree["asset"]["generator"] = "PhySIC"
        if texture:
            tree["extensionsUsed"] = ["KHR_materials_unlit"]
            tree["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]
            tree["images"] = [{"bufferView": len(buffers), "mimeType": "image/jpeg"}]
            tree["textures"] = [{"source": 0, "sampler": 0}]
            buffers["texture"] = texture + b"\0" * (-len(texture) % 4)

    content: bytes = trimesh.exchange.gltf.export_glb(scene, buffer_postprocessor=add_materials)
    return content
