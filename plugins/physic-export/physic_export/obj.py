"""Wavefront OBJ: meshes of the scene and the bodies, with vertex colours and normals."""

from __future__ import annotations

import io

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_export.meshes import contact_lines, person_meshes, scene_mesh

__all__ = ["export_obj"]


def export_obj(request: ExportRequest) -> ExportedFiles:
    """Return one OBJ file with an object for the scene and for each person; vertices have r, g, b in 0-1."""
    scene = scene_mesh(request)
    meshes = [*([scene] if scene is not None else []), *person_meshes(request)]
    text = io.StringIO()
    text.write(f"# PhySIC; unit: metre; axes: {request.frame.axes}\n# v: x y z red green blue (sRGB, 0 to 1)\n")
    text.writelines(f"# contact: {line}\n" for line in contact_lines(request.result))
    start = 1
    for mesh in meshes:
        text.write(f"o {mesh.name}\n")
        np.savetxt(text, np.concatenate([mesh.vertices, mesh.colors / 255], 1), "v %.5f %.5f %.5f %.3f %.3f %.3f")
        np.savetxt(text, mesh.normals, "vn %.4f %.4f %.4f")
        corners = np.repeat(mesh.faces + start, 2, axis=1)
        np.savetxt(text, corners, "f %d//%d %d//%d %d//%d")
        start += len(mesh.vertices)
    return ExportedFiles({f"{request.stem}{request.suffix}": text.getvalue().encode("ascii")})
