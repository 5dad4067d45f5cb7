"""Coloured meshes of people and scene, which several formats share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.upright import transform_points
from physic_core.visual.palette import contact_legend
from physic_core.visual.surface import depth_limit, mesh_scene, unit_normals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, Reconstruction, UInt8Array
    from physic_core.visual.export.request import ExportRequest
    from physic_export.skins import Skins


@dataclass(frozen=True)
class ColoredMesh:
    """Mesh with a colour and a normal per vertex, in the frame of an export.

    Attributes:
        name: "scene", "person_0", ...
        vertices: (V, 3) metres.
        faces: (F, 3), counter-clockwise seen from outside or from the camera.
        normals: (V, 3) float32 unit.
        colors: (V, 3) uint8 sRGB.
        contact: (V,) bool; all False for the scene.
        uv: (V, 2) texture coordinates of the scene, v up; None for other meshes.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float32]
    colors: UInt8Array
    contact: BoolArray
    uv: NDArray[np.float64] | None = None


def person_meshes(request: ExportRequest, skins: Skins) -> list[ColoredMesh]:
    """Return the posed bodies of a request."""
    made = []
    for index, person in request.chosen():
        vertices = transform_points(request.frame.from_camera, person.vertices)
        faces = np.asarray(request.result.faces, np.int64)
        normals = unit_normals(vertices, faces)
        colors = skins.vertex_colors(index)
        made.append(ColoredMesh(f"person_{index}", vertices, faces, normals, colors, person.contact))
    return made


def contact_lines(result: Reconstruction, skins: Skins) -> list[str]:
    """Return the legend of contact, such as "floor is sRGB 24 140 130", for the comments of a file that shows it."""
    if skins.kind != "contact":
        return []
    return [f"{label} is sRGB {rgb[0]} {rgb[1]} {rgb[2]}" for label, rgb in contact_legend(result).items()]


def scene_mesh(request: ExportRequest, max_vertices: int = 130_000) -> ColoredMesh | None:
    """Return the mesh of the scene; None if no pixels form a surface, or the scene is not wanted."""
    scene = request.result.scene
    surface = mesh_scene(scene, depth_limit(request.result), max_vertices)
    if not request.scene or not len(surface.faces):
        return None
    columns, rows = surface.pixels.T
    vertices = transform_points(request.frame.from_camera, surface.vertices)
    return ColoredMesh(
        "scene",
        vertices,
        surface.faces,
        unit_normals(vertices, surface.faces),
        scene.colors[rows, columns],
        np.zeros(len(surface.vertices), bool),
        np.stack([(columns + 0.5) / scene.valid.shape[1], 1 - (rows + 0.5) / scene.valid.shape[0]], 1),
    )
