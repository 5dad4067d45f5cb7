"""Coloured meshes of people and scene, and the formats of meshes: PLY, OBJ and STL.

PLY has every valid point of the scene; OBJ has meshes with textures; STL has bodies to print.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry import transform_points
from physic_export.skins import Skins, skins_of
from physic_visual.palette import BODY_RGB, contact_legend
from physic_visual.scene_mesh import mesh_scene, scene_reach, unit_normals
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from physic_core.export import ExportFrame
    from physic_core.types import (
        AnyArray,
        BoolArray,
        Float32Array,
        Float64Array,
        Int64Array,
        Plane,
        Reconstruction,
        UInt8Array,
    )


_VERTEX = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")),
        *((name, "u1") for name in ("red", "green", "blue", "contact")),
        ("object", "<i4"),
        ("quality", "<f4"),
    ]
)


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
    vertices: Float64Array
    faces: Int64Array
    normals: Float32Array
    colors: UInt8Array
    contact: BoolArray
    uv: Float64Array | None = None


def person_meshes(request: ExportRequest, skins: Skins) -> list[ColoredMesh]:
    """Return the posed bodies of a request."""
    meshes = []
    for index, person in request.chosen():
        vertices = transform_points(request.frame.from_camera, person.vertices)
        faces = np.asarray(request.result.faces, np.int64)
        normals = unit_normals(vertices, faces)
        colors = skins.vertex_colors(index)
        meshes.append(
            ColoredMesh(f"person_{index}", vertices, faces, normals, colors, person.contact)
        )
    return meshes


def contact_lines(result: Reconstruction, skins: Skins) -> list[str]:
    """Return the legend of contact, such as "floor is sRGB 24 140 130", for the comments of a file
    that shows it.
    """
    if skins.kind != "contact":
        return []
    return [
        f"{label} is sRGB {rgb[0]} {rgb[1]} {rgb[2]}"
        for label, rgb in contact_legend(result).items()
    ]


def scene_mesh(request: ExportRequest, max_vertices: int = 130_000) -> ColoredMesh | None:
    """Return the mesh of the scene; None if no pixels form a surface, or the scene is not
    wanted.
    """
    scene = request.result.scene
    surface = mesh_scene(scene, scene_reach(request.result), max_vertices)
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
        np.stack(
            [(columns + 0.5) / scene.valid.shape[1], 1 - (rows + 0.5) / scene.valid.shape[0]], 1
        ),
    )


_FACE = np.dtype([("count", "u1"), ("vertex_indices", "<i4", (3,))])


def export_ply(request: ExportRequest) -> ExportedFiles:
    """Return one binary PLY file; its vertices have ``object``: -1 is the scene, 0, 1, ... are
    people.

    ``quality`` is the probability of contact, 0 or 1 if none is estimated: the one property that
    MeshLab keeps.
    """
    skins = skins_of(request)
    parts = [(-1, scene_points(request))] if request.scene else []
    parts += list(zip(request.person, person_meshes(request, skins), strict=True))
    vertices = []
    faces = []
    start = 0
    for number, mesh in parts:
        rows = np.zeros(len(mesh.vertices), _VERTEX)
        for axis, name in enumerate("xyz"):
            rows[name] = mesh.vertices[:, axis]
            rows[f"n{name}"] = mesh.normals[:, axis]
        rows["red"], rows["green"], rows["blue"] = mesh.colors.T
        rows["contact"] = mesh.contact
        rows["object"] = number
        rows["quality"] = mesh.contact
        if (
            number >= 0
            and (probability := request.result.people[number].contact_probability) is not None
        ):
            rows["quality"] = probability
        vertices.append(rows)
        triangles = np.zeros(len(mesh.faces), _FACE)
        triangles["count"] = 3
        triangles["vertex_indices"] = mesh.faces + start
        faces.append(triangles)
        start += len(rows)
    header = _ply_header(request, skins, sum(map(len, vertices)), sum(map(len, faces)))
    content = b"".join([header, *(rows.data for rows in (*vertices, *faces))])
    return ExportedFiles({f"{request.stem}{request.suffix}": content}, skins.notes)


def scene_points(request: ExportRequest) -> ColoredMesh:
    """Return all valid points of the scene, and the faces between neighbours on one surface."""
    scene = request.result.scene
    matrix = request.frame.from_camera
    height, width = scene.valid.shape
    usable = scene.valid & np.isfinite(scene.points).all(-1)
    surface = mesh_scene(scene, scene_reach(request.result), height * width)
    number = np.cumsum(usable.reshape(-1)) - 1
    columns, rows = surface.pixels.T
    faces = (
        number[rows * width + columns][surface.faces]
        if len(surface.faces)
        else np.zeros((0, 3), np.int64)
    )
    return ColoredMesh(
        "scene",
        transform_points(matrix, scene.points[usable]),
        faces,
        (np.asarray(scene.normals[usable], np.float64) @ matrix[:3, :3].T).astype(np.float32),
        scene.colors[usable],
        np.zeros(int(usable.sum()), bool),
    )


_PROPERTY = {"f4": "float", "u1": "uchar", "i4": "int"}


def _ply_header(request: ExportRequest, skins: Skins, vertices: int, faces: int) -> bytes:
    frame = request.frame
    floor = request.result.scene.floor
    plane = "none" if floor is None else _floor_equation(frame, floor)
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment PhySIC; unit: meter",
        f"comment axes: {frame.axes}",
        f"comment floor: {plane}",
        "comment object: -1 scene, 0 and up people; contact: 1 touches; normals of the scene are "
        "0 where unknown",
        *(f"comment contact: {line}" for line in contact_lines(request.result, skins)),
        f"element vertex {vertices}",
        *(
            f"property {_PROPERTY[dtype.str[1:]]} {name}"
            for name, (dtype, *_) in _VERTEX.fields.items()  # type: ignore[union-attr]
        ),
        f"element face {faces}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii")


def _floor_equation(frame: ExportFrame, floor: Plane) -> str:
    """Return the floor as an equation in the frame."""
    normal = frame.from_camera[:3, :3] @ np.asarray(floor.normal, np.float64)
    offset = floor.offset - float(normal @ frame.from_camera[:3, 3])
    a, b, c = (round(float(v), 6) + 0.0 for v in normal)
    return f"{a:g} x + {b:g} y + {c:g} z + {round(offset, 6) + 0.0:g} = 0"


_TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
_MM = 1000.0


def export_stl(request: ExportRequest) -> ExportedFiles:
    """Return a binary STL file of each person, a closed mesh in millimetres, which slicers expect.

    The surface of the scene has no inside, and is left out.
    """
    files = {}
    for index, person in request.chosen():
        vertices = transform_points(request.frame.from_camera, person.vertices) * _MM
        rows = np.zeros(len(request.result.faces), _TRIANGLE)
        rows["corners"] = vertices[request.result.faces]
        across = np.cross(
            rows["corners"][:, 1] - rows["corners"][:, 0],
            rows["corners"][:, 2] - rows["corners"][:, 0],
        )
        rows["normal"] = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        head = f"PhySIC; unit: millimeter; {request.frame.up} up".encode("ascii").ljust(80)
        count = len(rows).to_bytes(4, "little")
        files[request.file_of(index)] = head + count + rows.tobytes()
    note = "lengths are in millimeters, as slicers read them, at life size: scale the body"
    return ExportedFiles(files, (note,))


def export_obj(request: ExportRequest) -> ExportedFiles:
    """Return an OBJ file, its materials (.mtl), and their pictures.

    There is an object for the scene and for each person; vertices have r, g, b in 0-1. A person has
    the materials ``person_0_photo`` (with the pictures of the photo's colours, and of where they
    are filled), ``person_0_neutral`` and ``person_0_contact``; the option ``skin`` says which one
    is used.
    """
    skins = skins_of(request)
    files = skins.pictures()
    scene = scene_mesh(request)
    text = [
        f"# PhySIC; unit: meter; axes: {request.frame.axes}\n# v: x y z red green blue (sRGB, 0 "
        f"to 1)\n# Programs that read OBJ in millimeters need a scale of 1000.\n",
        *(f"# contact: {line}\n" for line in contact_lines(request.result, skins)),
        f"mtllib {request.stem}.mtl\n",
    ]
    next_indices = (1, 1)
    if scene is not None and scene.uv is not None:
        files[f"{request.stem}_scene.jpg"] = encode_image(request.result.scene.colors, "JPEG")
        next_indices = _append_object(text, scene, "scene", scene.uv, scene.faces, next_indices)
    for mesh in person_meshes(request, skins):
        uv = np.zeros((0, 2))
        corners = None
        if skins.mesh is not None:
            uv = skins.mesh.uv.astype(np.float64)
            corners = skins.mesh.faces
        next_indices = _append_object(
            text, mesh, f"{mesh.name}_{skins.kind}", uv, corners, next_indices
        )
    files[f"{request.stem}.mtl"] = _materials(request, skins, scene is not None).encode("ascii")
    return ExportedFiles(
        {f"{request.stem}{request.suffix}": "".join(text).encode("ascii"), **files}, skins.notes
    )


def _append_object(
    text: list[str],
    mesh: ColoredMesh,
    material: str,
    uv: Float64Array,
    corners: Int64Array | None,
    next_indices: tuple[int, int],
) -> tuple[int, int]:
    """Write an object; return the numbers of the next vertex and of the next texture coordinate.

    Args:
        text: of the file.
        mesh: the object.
        material: name.
        uv: (U, 2), v up.
        corners: (F, 3) indices into ``uv``, or None.
        next_indices: numbers of the first vertex and of the first texture coordinate.
    """
    vertex = mesh.faces + next_indices[0]
    if corners is None:
        numbers = np.repeat(vertex, 2, axis=1)
        face = "f %d//%d %d//%d %d//%d\n"
    else:
        numbers = np.stack([vertex, corners + next_indices[1], vertex], 2).reshape(-1, 9)
        face = "f %d/%d/%d %d/%d/%d %d/%d/%d\n"
    colored = np.concatenate([mesh.vertices, mesh.colors / 255], 1)
    text.append(f"o {mesh.name}\n")
    text += _format_rows("v %.9g %.9g %.9g %.3f %.3f %.3f\n", colored)
    text += _format_rows("vn %.4f %.4f %.4f\n", mesh.normals)
    text += _format_rows("vt %.5f %.5f\n", uv)
    text.append(f"usemtl {material}\n")
    text += _format_rows(face, numbers)
    return next_indices[0] + len(mesh.vertices), next_indices[1] + len(uv)


_ROWS = 4096  # of a file at a time


def _format_rows(form: str, rows: AnyArray) -> list[str]:
    """Return the lines of rows (n, k), many in one string; ``np.savetxt`` takes twice as long."""
    blocks = (rows[start : start + _ROWS] for start in range(0, len(rows), _ROWS))
    return [form * len(block) % tuple(block.ravel().tolist()) for block in blocks]


_MATERIAL = "newmtl {name}\nKa 0 0 0\nKd {color}\nKs 0 0 0\nillum 1\n"


def _materials(request: ExportRequest, skins: Skins, with_scene: bool) -> str:
    materials = []
    white = "1 1 1"
    if with_scene:
        materials.append(
            _MATERIAL.format(name="scene", color=white) + f"map_Kd {request.stem}_scene.jpg\n"
        )
    grey = " ".join(f"{value / 255:.3f}" for value in BODY_RGB)
    for index in request.person:
        name = f"person_{index}"
        materials.append(_MATERIAL.format(name=f"{name}_neutral", color=grey))
        if skins.source:
            photo = _MATERIAL.format(name=f"{name}_photo", color=white)
            materials.append(
                f"# {request.stem}_{name}_filled.png is white where the photo does not show the "
                f"body\n{photo}map_Kd {request.stem}_{name}.jpg\n"
            )
        contact = _MATERIAL.format(name=f"{name}_contact", color=white if skins.source else grey)
        picture = f"map_Kd {request.stem}_{name}_contact.png\n" if skins.source else ""
        materials.append(contact + picture)
    return "\n".join(materials)
