"""Files of a scene: the result of the reference photo, all cameras, the merged points, and a row for each photo."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import trimesh
from PIL import Image

from physic_core.files.atomic import atomic_write
from physic_core.files.strict_json import to_json

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array
    from physic_scene.types import CameraPose, SceneResult

__all__ = ["CAMERAS_FILE", "camera_document", "draw_photos", "save_scene"]

CAMERAS_FILE, POINTS_FILE, PHOTOS_FILE = "cameras.json", "scene_points.ply", "photos.png"

_ROW_PX = 360  # height of a photo in the picture
_GAP_PX = 6
_COLOURS = (
    (214, 84, 84),
    (72, 133, 237),
    (60, 160, 90),
    (235, 160, 40),
    (150, 90, 200),
    (40, 170, 180),
    (200, 90, 150),
)


def save_scene(scene: SceneResult, folder: str, *, overwrite: bool = False) -> None:
    """Write the files of the reference photo's result, ``cameras.json``, ``scene_points.ply`` and ``photos.png``.

    Args:
        scene: what to write.
        folder: created if missing.
        overwrite: whether to replace the result of another photo.

    Raises:
        OutputError: the folder cannot be written, or a file of the user's would be lost.
    """
    scene.reconstruction.save(folder, overwrite=overwrite)
    picture = io.BytesIO()
    Image.fromarray(draw_photos(scene)).save(picture, "PNG", compress_level=2)
    cloud = trimesh.PointCloud(scene.points, scene.colors).export(file_type="ply")
    with atomic_write(Path(folder)) as temporary:
        temporary(CAMERAS_FILE).write_text(json.dumps(camera_document(scene), indent=1) + "\n", "utf-8")
        temporary(POINTS_FILE).write_bytes(cloud)
        temporary(PHOTOS_FILE).write_bytes(picture.getvalue())


def camera_document(scene: SceneResult) -> dict[str, Any]:
    """Return what ``cameras.json`` holds; docs/scene.md states its keys."""
    cameras = [
        {
            "photo": camera.photo,
            "index": camera.index,
            "reference": camera.index == scene.reference,
            "width": camera.intrinsics.width,
            "height": camera.intrinsics.height,
            "K": camera.intrinsics.matrix,
            "rotation": camera.rotation,
            "translation_m": camera.translation,
            "centre_m": camera.centre,
            "rotation_sigma_deg": camera.rotation_sigma_deg,
            "position_sigma_m": camera.position_sigma_m,
            "focal_sigma": camera.focal_sigma,
            "people": list(camera.people),
            "reprojection_share": camera.reprojection if np.isfinite(camera.reprojection) else None,
            "scene_scale": camera.scene_scale,
        }
        for camera in scene.cameras
    ]
    people = [
        {
            "views": list(person.views),
            "row": person.row,
            "moved": person.moved,
            "joints_m": person.joints,
            "parameters": {name: value[0] for name, value in vars(person.parameters).items()},
        }
        for person in scene.people
    ]
    left_out = [{"photo": one.photo, "index": one.index, "reason": one.reason} for one in scene.left_out]
    document: dict[str, Any] = to_json(
        {
            "version": 1,
            "cameras": cameras,
            "people": people,
            "left_out": left_out,
            "notes": list(scene.notes),
            "diagnostics": scene.diagnostics,
        },
        digits=7,
    )
    return document


def draw_photos(scene: SceneResult) -> UInt8Array:
    """Return a picture with a row for each photo: the photo, and the same with the solved bodies over it."""
    rows = [_row(scene, camera) for camera in scene.cameras]
    width = max(row.shape[1] for row in rows)
    gap = np.full((_GAP_PX, width, 3), 255, np.uint8)
    page = []
    for row in rows:
        filled = np.full((row.shape[0], width, 3), 255, np.uint8)
        filled[:, : row.shape[1]] = row
        page += [filled, gap]
    return np.concatenate(page[:-1])


def _row(scene: SceneResult, camera: CameraPose) -> UInt8Array:
    """Return a photo beside the same photo with bodies, and the name of the photo."""
    photo = np.asarray(camera.result.image)
    scale = _ROW_PX / photo.shape[0]
    size = (max(1, round(photo.shape[1] * scale)), _ROW_PX)
    small = cv2.resize(photo, size, interpolation=cv2.INTER_AREA)
    K = camera.intrinsics.matrix * [[scale], [scale], [1.0]]
    bodies = _overlay(small, scene, camera, K)
    mark = " (reference)" if camera.index == scene.reference else ""
    text, font = f"{camera.photo}{mark}", cv2.FONT_HERSHEY_SIMPLEX
    (wide, high), _ = cv2.getTextSize(text, font, 0.6, 1)
    cv2.rectangle(small, (0, 0), (wide + 16, high + 16), (255, 255, 255), cv2.FILLED)
    cv2.putText(small, text, (8, high + 8), font, 0.6, (30, 30, 30), 1, cv2.LINE_AA)
    gap = np.full((_ROW_PX, _GAP_PX, 3), 255, np.uint8)
    return np.concatenate([small, gap, bodies], axis=1)


def _overlay(photo: UInt8Array, scene: SceneResult, camera: CameraPose, K: FloatArray) -> UInt8Array:
    """Return a photo with the faces of all solved bodies over it, far ones first."""
    drawn, faces = photo.copy(), scene.reconstruction.faces
    light = np.array([0.3, -0.5, -0.8]) / np.linalg.norm([0.3, -0.5, -0.8])
    triangles, depths, shades = [], [], []
    for number, person in enumerate(scene.people):
        if person.moved:
            continue
        local = np.asarray(person.vertices, np.float64) @ camera.rotation.T + camera.translation
        corners = local[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        facing = ((normals * corners[:, 0]).sum(1) < 0) & (corners[..., 2] > 0.1).all(1)
        uv = corners[facing] @ K.T
        triangles.append(uv[..., :2] / uv[..., 2:])
        depths.append(corners[facing][..., 2].mean(1))
        bright = 0.35 + 0.65 * np.clip(normals[facing] @ light, 0, 1)
        shades.append(bright[:, None] * np.array(_COLOURS[number % len(_COLOURS)]))
    if not triangles:
        return drawn
    corners, depth, shade = (np.concatenate(parts) for parts in (triangles, depths, shades))
    near = np.abs(corners).max((1, 2)) < 4 * max(photo.shape)
    for i in np.flatnonzero(near)[np.argsort(-depth[near])]:
        cv2.fillConvexPoly(drawn, np.round(corners[i] * 8).astype(np.int32), shade[i].tolist(), cv2.LINE_8, 3)
    blended: UInt8Array = cv2.addWeighted(drawn, 0.75, photo, 0.25, 0)
    return blended
