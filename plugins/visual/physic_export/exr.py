"""EXR: depth as 32-bit floats in metres, without and with people, and a mask of what is
inpainted.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry import pixel_rays, project, rasterize
from physic_export.depth import depth_of_scene, files_beside, mask_picture

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Int64Array


NOTHING_M = 1e10
"""Depth where none is known, as Blender writes it; inf and NaN spread in filters of pictures."""


def export_exr(request: ExportRequest) -> ExportedFiles:
    """Return the depth along z of the scene without people, ``STEM_people.exr`` with them, a mask
    of each body that this depth has, a mask of what is inpainted, and the files of
    :func:`physic_export.depth.files_beside`, among them masks of people in the photo.

    Each EXR file has the depth as channel ``Z`` and, for readers of pictures, as ``Y``; 32-bit
    floats, metres.
    """
    scene = depth_of_scene(request, NOTHING_M)
    with_people, owner = _with_people(scene, request)
    bodies = {
        f"{request.stem}_body_{index}.png": mask_picture(owner == index) for index in request.person
    }
    inpainted = np.any(request.result.scene.colors != request.result.image, axis=-1)
    unit = {"unit_m": 1.0, "unknown": NOTHING_M}
    return ExportedFiles(
        {
            f"{request.stem}{request.suffix}": _exr(scene),
            f"{request.stem}_people{request.suffix}": _exr(with_people),
            **bodies,
            f"{request.stem}_inpainted.png": mask_picture(inpainted),
            **files_beside(request, unit),
        }
    )


def _with_people(depth: FloatArray, request: ExportRequest) -> tuple[FloatArray, Int64Array]:
    """Return a depth (H, W) with the bodies that are in front of it, and the person whose body each
    pixel shows (H, W), -1 for none.
    """
    K = torch.from_numpy(np.asarray(request.result.intrinsics.matrix, np.float64))
    height, width = depth.shape
    rays = pixel_rays(height, width, K).numpy()
    nearest = depth.copy()
    owner = np.full(depth.shape, -1)
    for index, person in request.chosen():
        body = person.vertices.astype(np.float64)
        points = torch.from_numpy(body)[None]
        faces = torch.from_numpy(request.result.faces)
        face_of_pixel = rasterize(project(points, K), points[..., 2], faces, height, width)[
            0
        ].numpy()
        is_visible = face_of_pixel >= 0
        first, second, third = np.moveaxis(
            body[request.result.faces[face_of_pixel[is_visible]]], 1, 0
        )
        normal = np.cross(second - first, third - first)
        # where the ray of the pixel meets the plane of the face
        z = (normal * first).sum(1) / (normal * rays[is_visible]).sum(1)
        owner[is_visible] = np.where(z < nearest[is_visible], index, owner[is_visible])
        nearest[is_visible] = np.minimum(nearest[is_visible], z)
    return nearest, owner


def _exr(depth: FloatArray) -> bytes:
    """Return the content of an EXR file; the package writes to a path alone."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "depth.exr"
        # the package writes the memory behind a view
        rows = np.ascontiguousarray(depth)
        OpenEXR.File(header, {"Y": rows, "Z": rows}).write(str(path))
        return path.read_bytes()
