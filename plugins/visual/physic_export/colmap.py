"""COLMAP's binary model: the camera, the pose of the photo, and points of the scene that the photo
shows.

Conventions are those of COLMAP's page "Output format": poses are from the world to a camera that
looks along z with y down, and pixels are counted from the corner of the picture. The model is
binary, since the reader of gsplat's examples fails on text.
"""

from __future__ import annotations

import math
import struct
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.errors import ConfigError
from physic_core.geometry import rotmat_to_quat, transform_points
from physic_export.depth import mask_picture, pixels_of_people
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from physic_core.export import ExportFrame
    from physic_core.types import Float64Array, IntArray, Intrinsics, UInt8Array

_MAX_POINTS = 100_000
"""As many as tools that train on points start with."""

_PHOTO = "photo.jpg"
_PINHOLE = 1
"""Number of the camera model fx, fy, cx, cy."""

_PIXEL = np.dtype([("xy", "<f8", (2,)), ("point", "<i8")])
_POINT = np.dtype(
    [
        ("id", "<u8"),
        ("xyz", "<f8", (3,)),
        ("rgb", "u1", (3,)),
        ("error", "<f8"),
        ("views", "<u8"),
        ("image", "<i4"),
        ("pixel", "<i4"),
    ]
)


def export_colmap(request: ExportRequest) -> ExportedFiles:
    """Return ``cameras.bin``, ``images.bin``, ``points3D.bin``, the photo, and a mask that is 0
    where people are.

    The points are those of a regular grid of pixels that show the scene, not a person. The model is
    in the folder ``sparse/0`` unless a file is named, the photo in ``images``, and the mask in
    ``masks``.

    Raises:
        ConfigError: the scene is to be left out, or the named file is not cameras.bin.
    """
    stem = PurePosixPath(request.stem)
    if stem.name != "cameras":
        raise ConfigError(
            f"COLMAP reads cameras.bin, not {stem.name}{request.suffix}: name that file, or a "
            f"folder"
        )
    if not request.scene:
        raise ConfigError(
            "this format has points of the scene: leave out --no-scene (scene=False in Python)"
        )
    result = request.result
    people = pixels_of_people(result)
    is_exported = result.scene.valid & np.isfinite(result.scene.points).all(-1) & ~people
    step = max(1, math.ceil(math.sqrt(is_exported.sum() / _MAX_POINTS)))
    rows, columns = (step * places for places in np.nonzero(is_exported[::step, ::step]))
    points = transform_points(
        request.frame.from_camera, result.scene.points[rows, columns].astype(np.float64)
    )
    model = {
        "cameras.bin": _cameras_file(result.intrinsics),
        "images.bin": _images_file(request.frame, rows, columns),
        "points3D.bin": _points_file(points, result.scene.colors[rows, columns]),
    }
    files = {
        f"images/{_PHOTO}": encode_image(result.image, "JPEG"),
        f"masks/{_PHOTO}.png": mask_picture(~people),
    }
    files |= {str(stem.parent / name): content for name, content in model.items()}
    note = f"{len(points)} points of {int(is_exported.sum())} pixels that show the scene"
    return ExportedFiles(files, (note,))


def _cameras_file(camera: Intrinsics) -> bytes:
    sizes = struct.pack("<QiiQQ", 1, 1, _PINHOLE, camera.width, camera.height)
    return sizes + struct.pack("<4d", camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5)


def _images_file(frame: ExportFrame, rows: IntArray, columns: IntArray) -> bytes:
    """Return the pose, and each pixel with the number of its point."""
    pose = np.linalg.inv(frame.from_camera)
    quaternion = rotmat_to_quat(pose[:3, :3])[[3, 0, 1, 2]]
    pixels = np.zeros(len(rows), _PIXEL)
    pixels["xy"] = np.column_stack([columns, rows]) + 0.5
    pixels["point"] = np.arange(1, len(rows) + 1)
    head = struct.pack("<Qi7di", 1, 1, *quaternion, *pose[:3, 3], 1)
    return head + _PHOTO.encode() + b"\0" + struct.pack("<Q", len(rows)) + pixels.tobytes()


def _points_file(points: Float64Array, colors: UInt8Array) -> bytes:
    """Return each point with its colour and its place in the list of pixels."""
    records = np.zeros(len(points), _POINT)
    records["id"] = np.arange(1, len(points) + 1)
    records["xyz"] = points
    records["rgb"] = colors
    records["views"] = 1
    records["image"] = 1
    records["pixel"] = np.arange(len(points))
    return struct.pack("<Q", len(points)) + records.tobytes()
