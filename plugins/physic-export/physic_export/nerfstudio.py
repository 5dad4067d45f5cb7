"""Nerfstudio: ``transforms.json`` with photo, depth, mask and camera.

The conventions are those of nerfstudio's page "Data conventions": a camera looks along -z with y up, the world has z
up, and pixels are counted from the corner of the picture.
"""

from __future__ import annotations

import json

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.visual.export.request import camera_pose
from physic_core.visual.textures.pictures import encode_image
from physic_export.depth import UNIT_M, depth_picture, mask_picture


def export_nerfstudio(request: ExportRequest) -> ExportedFiles:
    """Return ``transforms.json`` with one frame, its photo, the depth of the scene, and a mask.

    The depth is that of the scene without people. The mask is therefore 0 where people are: nerfstudio does not sample
    there.
    """
    result, camera = request.result, request.result.intrinsics
    photo, depth_file, mask = (f"{request.stem}_{name}" for name in ("photo.jpg", "depth.png", "mask.png"))
    depth, notes = depth_picture(request)
    without_people = ~np.any([np.zeros_like(result.scene.valid), *(person.mask for person in result.people)], axis=0)
    document = {
        "camera_model": "OPENCV",
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx + 0.5,  # counted from the corner of the first pixel, not from its centre
        "cy": camera.cy + 0.5,
        "w": camera.width,
        "h": camera.height,
        "depth_unit_scale_factor": UNIT_M,
        "orientation_override": "none",  # the frame has its up axis already
        "frames": [
            {
                "file_path": photo,
                "depth_file_path": depth_file,
                "mask_path": mask,
                "transform_matrix": camera_pose(request.frame).tolist(),
            }
        ],
    }
    files = {photo: encode_image(result.image, "JPEG"), depth_file: depth, mask: mask_picture(without_people)}
    text = json.dumps(document, indent=2) + "\n"
    return ExportedFiles({f"{request.stem}{request.suffix}": text.encode(), **files}, notes)
