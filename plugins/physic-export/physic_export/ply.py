"""PLY: every valid point of the scene and the bodies, with colours, normals, contact and faces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry.upright import transform_points
from physic_core.visual.surface import depth_limit, mesh_scene
from physic_export.meshes import ColoredMesh, contact_lines, person_meshes
from physic_export.skins import Skins, skins_of

if TYPE_CHECKING:
    from physic_core.types import Plane
    from physic_core.visual.export.request import ExportFrame

_VERTEX = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")),
        *((name, "u1") for name in ("red", "green", "blue", "contact")),
        ("object", "<i4"),
    ]
)
_FACE = np.dtype([("count", "u1"), ("vertex_indices", "<i4", (3,))])
_PROPERTY = {"f4": "float", "u1": "uchar", "i4": "int"}


def export_ply(request: ExportRequest) -> ExportedFiles:
    """Return one binary PLY file; its vertices have ``object``: -1 is the scene, 0, 1, ... are people."""
    skins = skins_of(request)
    parts = [(-1, scene_points(request))] if request.scene else []
    parts += list(zip(request.people, person_meshes(request, skins), strict=True))
    vertices, faces, start = [], [], 0
    for number, mesh in parts:
        rows = np.zeros(len(mesh.vertices), _VERTEX)
        for axis, name in enumerate("xyz"):
            rows[name], rows[f"n{name}"] = mesh.vertices[:, axis], mesh.normals[:, axis]
        rows["red"], rows["green"], rows["blue"] = mesh.colors.T
        rows["contact"], rows["object"] = mesh.contact, number
        vertices.append(rows)
        triangles = np.zeros(len(mesh.faces), _FACE)
        triangles["count"], triangles["vertex_indices"] = 3, mesh.faces + start
        faces.append(triangles)
        start += len(rows)
    points = np.concatenate(vertices) if vertices else np.zeros(0, _VERTEX)
    triangles = np.concatenate(faces) if faces else np.zeros(0, _FACE)
    header = _header(request, skins, len(points), len(triangles))
    return ExportedFiles(
        {f"{request.stem}{request.suffix}": header + points.tobytes() + triangles.tobytes()}, skins.notes
    )


def scene_points(request: ExportRequest) -> ColoredMesh:
    """Return all valid points of the scene, and the faces between neighbours on one surface."""
    scene = request.result.scene
    matrix = request.frame.from_camera
    height, width = scene.valid.shape
    usable = scene.valid & np.isfinite(scene.points).all(-1)
    surface = mesh_scene(scene, depth_limit(request.result), height * width)
    number = np.cumsum(usable.reshape(-1)) - 1
    columns, rows = surface.pixels.T
    faces = number[rows * width + columns][surface.faces] if len(surface.faces) else np.zeros((0, 3), np.int64)
    return ColoredMesh(
        "scene",
        transform_points(matrix, scene.points[usable]),
        faces,
        (np.asarray(scene.normals[usable], np.float64) @ matrix[:3, :3].T).astype(np.float32),
        scene.colors[usable],
        np.zeros(int(usable.sum()), bool),
    )


def _header(request: ExportRequest, skins: Skins, vertices: int, faces: int) -> bytes:
    frame, floor = request.frame, request.result.scene.floor
    plane = "none" if floor is None else _plane(frame, floor)
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment PhySIC; unit: metre",
        f"comment axes: {frame.axes}",
        f"comment floor: {plane}",
        "comment object: -1 scene, 0 and up people; contact: 1 touches; normals of the scene are 0 where unknown",
        *(f"comment contact: {line}" for line in contact_lines(request.result, skins)),
        f"element vertex {vertices}",
        *(f"property {_PROPERTY[dtype.str[1:]]} {name}" for name, (dtype, *_) in _VERTEX.fields.items()),  # type: ignore[union-attr]
        f"element face {faces}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii")


def _plane(frame: ExportFrame, floor: Plane) -> str:
    """Return the floor as an equation in the frame."""
    normal = frame.from_camera[:3, :3] @ np.asarray(floor.normal, np.float64)
    offset = floor.offset - float(normal @ frame.from_camera[:3, 3])
    a, b, c = (round(float(v), 6) + 0.0 for v in normal)
    return f"{a:g} x + {b:g} y + {c:g} z + {round(offset, 6) + 0.0:g} = 0"
