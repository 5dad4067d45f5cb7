"""Files of a scene: the result with all cameras, what is known of the moment beside it, and the merged points."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from physic_core import save_reconstruction
from physic_core.files.strict_json import to_json

if TYPE_CHECKING:
    from physic_scene.types import SceneResult

MOMENT_FILE, POINTS_FILE, REPORT_FILE = "moment.json", "scene_points.ply", "report.html"


def save_scene(scene: SceneResult, folder: str, *, overwrite: bool = False, page: str = "", photos: str = "") -> None:
    """Write the files of ``Reconstruction.save``, ``moment.json`` and ``scene_points.ply``, as one result.

    Args:
        scene: what to write.
        folder: created if missing.
        overwrite: whether to replace the result of another photo.
        page: of the result, written as ``report.html``; "" for none.
        photos: digests of all photos, whose earlier results are replaced; "" for that of the reference alone.

    Raises:
        OutputError: the folder cannot be written, or a file of the user's would be lost.
    """
    cloud = trimesh.PointCloud(scene.points, scene.colors).export(file_type="ply")
    beside = {MOMENT_FILE: moment_json(scene).encode(), POINTS_FILE: cloud}
    beside |= {REPORT_FILE: page.encode()} if page else {}
    save_reconstruction(scene.reconstruction, folder, overwrite=overwrite, beside=beside, photos=photos)


def moment_json(scene: SceneResult) -> str:
    """Return the text of ``moment.json``."""
    return json.dumps(moment_document(scene), indent=1) + "\n"


def moment_document(scene: SceneResult) -> dict[str, Any]:
    """Return what ``moment.json`` holds; docs/scene.md states its keys."""
    cameras = sorted(scene.cameras, key=lambda camera: camera.index != scene.reference)
    photos = [
        {
            "index": camera.index,
            "people": list(camera.people),
            "reprojection_share": camera.reprojection if np.isfinite(camera.reprojection) else None,
            "scene_scale": camera.scene_scale,
        }
        for camera in cameras
    ]
    people = [
        {
            "views": list(person.views),
            "row": person.row,
            "moved": person.moved,
            "elsewhere": list(person.elsewhere),
        }
        for person in scene.people
    ]
    left_out = [{"photo": one.photo, "index": one.index, "reason": one.reason} for one in scene.left_out]
    document: dict[str, Any] = to_json(
        {
            "version": 1,
            "photos": photos,
            "people": people,
            "left_out": left_out,
            "diagnostics": scene.diagnostics,
        },
        digits=7,
    )
    return document
