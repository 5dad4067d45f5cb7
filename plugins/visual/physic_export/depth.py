"""Depth: the scene as a 16-bit PNG in millimetres, with its photo, masks of people, and the camera.

Nerfstudio gets them as ``transforms.json``. Its conventions are those of its page "Data
conventions": a camera looks along -z with y up, the world has z up, and pixels are counted from the
corner of the picture.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.errors import ConfigError
from physic_core.export import camera_pose
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Reconstruction

UNIT_M = 0.001
"""Metres of one step of a depth picture."""

_MAX_STEPS = 65535


def export_depth(request: ExportRequest) -> ExportedFiles:
    """Return the depth of the scene, the photo that it belongs to, a mask of each person, and the
    camera.

    All pictures have the pixels of ``Reconstruction.image``, which is upright and without lens
    distortion. The JSON file has the camera, and the names of the pictures.
    """
    depth, notes = depth_picture(request)
    unit = {"unit_m": UNIT_M, "unknown": 0}
    files = {f"{request.stem}{request.suffix}": depth, **files_beside(request, unit)}
    return ExportedFiles(files, notes)


def files_beside(request: ExportRequest, unit: dict[str, float]) -> dict[str, bytes]:
    """Return the photo, the masks of people, and the camera of a depth, with its unit in the JSON
    file.
    """
    photo = f"{request.stem}_photo.jpg"
    masks = {
        f"{request.stem}_person_{index}.png": mask_picture(person.mask)
        for index, person in request.chosen()
    }
    camera = request.result.intrinsics
    document = {
        **{name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")},
        "frame": f"OpenCV camera: {request.frame.axes}",
        "pixels": "integer coordinates are pixel centers; (0, 0) is the center of the top left "
        "pixel",
        "depth": {"file": f"{request.stem}{request.suffix}", **unit, "along": "z"},
        "photo": photo,
        "masks": dict(zip(map(str, request.person), masks, strict=True)),
    }
    text = json.dumps(document, indent=2) + "\n"
    return {
        photo: encode_image(request.result.image, "JPEG"),
        **masks,
        f"{request.stem}_camera.json": text.encode(),
    }


def depth_picture(request: ExportRequest) -> tuple[bytes, tuple[str, ...]]:
    """Return the depth of the scene along z as a 16-bit PNG in mm, 0 where it is unknown, and notes
    for the user.

    A pixel beyond the 65.535 m that 16 bits hold is 0 too, and a note counts them.
    """
    steps = np.rint(depth_of_scene(request, 0.0) / UNIT_M)
    far = steps > _MAX_STEPS
    note = (
        f"{far.mean():.0%} of the pixels are farther than {_MAX_STEPS * UNIT_M} m: they are 0, "
        f"as unknown ones"
    )
    return encode_image(np.where(far, 0, steps).astype(np.uint16), "PNG"), (
        note,
    ) if far.any() else ()


def depth_of_scene(request: ExportRequest, unknown: float) -> FloatArray:
    """Return the depth (H, W) of the scene without people along z, metres.

    Raises:
        ConfigError: the scene is to be left out.
    """
    if not request.scene:
        raise ConfigError(
            "this format is the depth of the scene: leave out --no-scene (scene=False in Python)"
        )
    scene = request.result.scene
    return np.where(scene.valid, scene.points[..., 2], np.float32(unknown))


def pixels_of_people(result: Reconstruction) -> BoolArray:
    """Return the pixels (H, W) that show a person."""
    masks = [np.zeros_like(result.scene.valid), *(person.mask for person in result.people)]
    return np.asarray(np.any(masks, axis=0))


def mask_picture(mask: BoolArray) -> bytes:
    """Return a mask (H, W) as a PNG of 8 bits: 255 where it is True, else 0."""
    return encode_image(np.where(mask, 255, 0).astype(np.uint8), "PNG")


def export_nerfstudio(request: ExportRequest) -> ExportedFiles:
    """Return ``transforms.json`` with one frame, its photo, the depth of the scene, and a mask.

    The depth is that of the scene without people. The mask is therefore 0 where people are:
    nerfstudio does not sample there.
    """
    result = request.result
    camera = request.result.intrinsics
    photo, depth_file, mask = (
        f"{request.stem}_{name}" for name in ("photo.jpg", "depth.png", "mask.png")
    )
    depth, notes = depth_picture(request)
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
    files = {
        photo: encode_image(result.image, "JPEG"),
        depth_file: depth,
        mask: mask_picture(~pixels_of_people(result)),
    }
    text = json.dumps(document, indent=2) + "\n"
    return ExportedFiles({f"{request.stem}{request.suffix}": text.encode(), **files}, notes)
