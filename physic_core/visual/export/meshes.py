"""Meshes that several formats share: normals, colours, the floor, and the objects of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.geometry.upright import transform_points
from physic_core.visual.palette import contact_colors, contact_legend
from physic_core.visual.surface import depth_limit, mesh_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, Reconstruction, UInt8Array
    from physic_core.visual.export.request import ExportRequest, Frame

__all__ = ["ColoredMesh", "contact_lines", "floor_square", "person_meshes", "scene_mesh", "vertex_normals"]

_FLOOR_MARGIN_M = 0.5


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
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float32]
    colors: UInt8Array
    contact: BoolArray


def person_meshes(request: ExportRequest) -> list[ColoredMesh]:
    """Return the posed bodies of a request."""
    made = []
    for index, person in request.chosen():
        vertices = transform_points(request.frame.from_camera, person.vertices)
        faces = np.asarray(request.result.faces, np.int64)
        normals = vertex_normals(vertices, faces)
        colors = contact_colors(person, request.result.contact_partners)
        made.append(ColoredMesh(f"person_{index}", vertices, faces, normals, colors, person.contact))
    return made


def contact_lines(result: Reconstruction) -> list[str]:
    """Return the legend of contact, such as "floor is sRGB 24 140 130", for the comments of a file."""
    return [f"{label} is sRGB {rgb[0]} {rgb[1]} {rgb[2]}" for label, rgb in contact_legend(result).items()]


def scene_mesh(request: ExportRequest, max_vertices: int = 130_000) -> ColoredMesh | None:
    """Return the mesh of the scene; None if no pixels form a surface, or the scene is not wanted."""
    scene = request.result.scene
    surface = mesh_scene(scene, depth_limit(request.result), max_vertices)
    if not request.scene or not len(surface.faces):
        return None
    columns, rows = surface.pixels.T
    return ColoredMesh(
        "scene",
        transform_points(request.frame.from_camera, surface.vertices),
        surface.faces,
        vertex_normals(surface.vertices, surface.faces, request.frame.from_camera),
        scene.colors[rows, columns],
        np.zeros(len(surface.vertices), bool),
    )


def vertex_normals(
    vertices: NDArray[np.floating[Any]], faces: NDArray[np.integer[Any]], turn: NDArray[np.float64] | None = None
) -> NDArray[np.float32]:
    """Return unit normals (V, 3): the mean of the faces at each vertex, weighted by area; +z where there is none.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        turn: (4, 4) rigid transform to apply to the normals.
    """
    corners = np.asarray(vertices, np.float64)[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((len(vertices), 3))
    for corner in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(faces[:, corner], area[:, axis], len(vertices))
    if turn is not None:
        total = total @ turn[:3, :3].T
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.where(length > 0, length, 1), [0.0, 0.0, 1.0]).astype(np.float32)


def floor_square(result: Reconstruction, frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Return vertices (4, 3) and faces (2, 3) of the floor under people, floor points and camera; None without one."""
    floor = result.scene.floor
    if floor is None:
        return None
    camera = np.zeros((1, 3))
    bodies = [person.vertices for person in result.people if np.isfinite(person.vertices).all()]
    points = transform_points(frame.from_camera, np.concatenate([camera, result.scene.floor_points, *bodies]))
    up = int(np.argmax(np.abs(frame.up_vector)))
    first, second = [axis for axis in range(3) if axis != up]
    low, high = points.min(0) - _FLOOR_MARGIN_M, points.max(0) + _FLOOR_MARGIN_M
    vertices = np.zeros((4, 3))
    vertices[:, first] = [low[first], high[first], high[first], low[first]]
    vertices[:, second] = [low[second], low[second], high[second], high[second]]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    normal = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    return vertices, faces if normal @ frame.up_vector > 0 else faces[:, ::-1]
