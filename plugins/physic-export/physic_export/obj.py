"""Wavefront OBJ: meshes of the scene and the bodies, with textures, vertex colours and normals."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.visual.palette import BODY_RGB
from physic_core.visual.textures.pictures import encode_image
from physic_export.meshes import ColoredMesh, contact_lines, person_meshes, scene_mesh
from physic_export.skins import Skins, skins_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MATERIAL = "newmtl {name}\nKa 0 0 0\nKd {color}\nKs 0 0 0\nillum 1\n"


def export_obj(request: ExportRequest) -> ExportedFiles:
    """Return an OBJ file, its materials (.mtl), and their pictures.

    There is an object for the scene and for each person; vertices have r, g, b in 0-1. A person has the materials
    ``person_0_photo`` (with the pictures of the photo's colours, and of where they are filled), ``person_0_neutral``
    and ``person_0_contact``; the option ``skin`` says which one is used.
    """
    skins = skins_of(request)
    files = skins.pictures()
    scene = scene_mesh(request)
    text = io.StringIO()
    text.write(f"# PhySIC; unit: metre; axes: {request.frame.axes}\n# v: x y z red green blue (sRGB, 0 to 1)\n")
    text.writelines(f"# contact: {line}\n" for line in contact_lines(request.result, skins))
    text.write(f"mtllib {request.stem}.mtl\n")
    at = (1, 1)
    if scene is not None and scene.uv is not None:
        files[f"{request.stem}_scene.jpg"] = encode_image(request.result.scene.colors, "JPEG")
        at = _write(text, scene, "scene", scene.uv, scene.faces, at)
    for mesh in person_meshes(request, skins):
        uv, corners = np.zeros((0, 2)), None
        if skins.textured is not None:
            uv, corners = skins.textured.mesh.uv.astype(np.float64), skins.textured.mesh.faces
        at = _write(text, mesh, f"{mesh.name}_{skins.kind}", uv, corners, at)
    files[f"{request.stem}.mtl"] = _materials(request, skins, scene is not None).encode("ascii")
    return ExportedFiles({f"{request.stem}{request.suffix}": text.getvalue().encode("ascii"), **files}, skins.notes)


def _write(
    text: io.StringIO,
    mesh: ColoredMesh,
    material: str,
    uv: NDArray[np.float64],
    corners: NDArray[np.int64] | None,
    at: tuple[int, int],
) -> tuple[int, int]:
    """Write an object; return the numbers of the next vertex and of the next texture coordinate.

    Args:
        text: of the file.
        mesh: the object.
        material: name.
        uv: (U, 2), v up.
        corners: (F, 3) indices into ``uv``, or None.
        at: numbers of the first vertex and of the first texture coordinate.
    """
    text.write(f"o {mesh.name}\n")
    np.savetxt(text, np.concatenate([mesh.vertices, mesh.colors / 255], 1), "v %.5f %.5f %.5f %.3f %.3f %.3f")
    np.savetxt(text, mesh.normals, "vn %.4f %.4f %.4f")
    np.savetxt(text, uv, "vt %.5f %.5f")
    text.write(f"usemtl {material}\n")
    vertex = mesh.faces + at[0]
    if corners is None:
        np.savetxt(text, np.repeat(vertex, 2, axis=1), "f %d//%d %d//%d %d//%d")
    else:
        numbers = np.stack([vertex, corners + at[1], vertex], 2).reshape(-1, 9)
        np.savetxt(text, numbers, "f %d/%d/%d %d/%d/%d %d/%d/%d")
    return at[0] + len(mesh.vertices), at[1] + len(uv)


def _materials(request: ExportRequest, skins: Skins, scene: bool) -> str:
    made, white = [], "1 1 1"
    if scene:
        made.append(_MATERIAL.format(name="scene", color=white) + f"map_Kd {request.stem}_scene.jpg\n")
    grey = " ".join(f"{value / 255:.3f}" for value in BODY_RGB)
    for index in request.people:
        name = f"person_{index}"
        made.append(_MATERIAL.format(name=f"{name}_neutral", color=grey))
        if skins.textured is not None:
            photo = _MATERIAL.format(name=f"{name}_photo", color=white)
            made.append(
                f"# {request.stem}_{name}_filled.png is white where the photo does not show the body\n{photo}"
                f"map_Kd {request.stem}_{name}.jpg\n"
            )
        contact = _MATERIAL.format(name=f"{name}_contact", color=white if skins.textured is not None else grey)
        made.append(contact + (f"map_Kd {request.stem}_{name}_contact.png\n" if skins.textured is not None else ""))
    return "\n".join(made)
