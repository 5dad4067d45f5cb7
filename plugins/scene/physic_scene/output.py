"""Files of a scene: the result, its cameras and who is who, and a picture of all photos."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from physic_core import save_reconstruction
from physic_core.files import to_json
from physic_core.io.result_folder import people_csv
from physic_scene.photos_picture import photos_png

if TYPE_CHECKING:
    from physic_scene.types import SceneResult

CAMERAS_FILE = "cameras.json"
PICTURE_FILE = "photos.png"
PEOPLE_TABLE = "people.csv"

_PINHOLE = ("fx", "fy", "cx", "cy", "width", "height", "focal_sigma")


def save_scene(
    scene: SceneResult,
    folder: str,
    *,
    overwrite: bool = False,
    page: str | None = None,
    photos: str = "",
) -> None:
    """Write the files of ``Reconstruction.save``, and the tables and pictures of a scene.

    Args:
        scene: what to write.
        folder: created if missing.
        overwrite: whether to replace the result of another photo.
        page: title of ``report.html``; None for no page.
        photos: digests of all photos, whose earlier results are replaced; "" for only the
            reference.

    Raises:
        OutputError: the folder cannot be written, or has a file of the user.
    """
    save_reconstruction(
        scene.reconstruction,
        folder,
        overwrite=overwrite,
        beside={
            CAMERAS_FILE: lambda: cameras_json(scene).encode(),
            PICTURE_FILE: lambda: photos_png(scene),
            PEOPLE_TABLE: lambda: people_csv(scene.reconstruction, scene.reference_photo.name),
        },
        page=page,
        photos=photos,
    )


def cameras_json(scene: SceneResult) -> str:
    """Return the text of ``cameras.json``; docs/scene.md states its keys."""
    photos = [
        {
            "photo": photo.name,
            "index": photo.index,
            "intrinsics": {name: getattr(photo.camera.intrinsics, name) for name in _PINHOLE},
            "rotation": photo.camera.rotation.tolist(),
            "translation": photo.camera.translation.tolist(),
            "rotation_sigma": photo.camera.rotation_sigma,
            "position_sigma": photo.camera.position_sigma,
            "people": list(photo.shown),
            "reprojection_share": photo.reprojection if np.isfinite(photo.reprojection) else None,
            "scene_scale": photo.scene_scale,
        }
        for photo in sorted(scene.photos, key=lambda photo: photo.index != scene.reference)
    ]
    document = {
        "photos": photos,
        "left_out": [
            {"photo": one.photo, "index": one.index, "reason": one.reason} for one in scene.left_out
        ],
    }
    return json.dumps(to_json(document), indent=1) + "\n"
