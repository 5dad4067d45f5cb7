"""Files of a scene: the result with all cameras, what is known of the moment beside it, and the merged points."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from physic_core import save_reconstruction
from physic_core.files.strict_json import to_json
from physic_core.io.people_table import people_csv

if TYPE_CHECKING:
    from physic_scene.types import SceneResult

MOMENT_FILE, POINTS_FILE, PEOPLE_TABLE, REPORT_FILE = "moment.json", "scene_points.ply", "people.csv", "report.html"


def save_scene(scene: SceneResult, folder: str, *, overwrite: bool = False, page: str = "", photos: str = "") -> None:
    """Write the files of ``Reconstruction.save``, with ``people.csv``, ``moment.json`` and ``scene_points.ply``.

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
    beside[PEOPLE_TABLE] = people_csv(scene.reconstruction, scene.reconstruction.cameras[0].photo)
    beside |= {REPORT_FILE: page.encode()} if page else {}
    save_reconstruction(scene.reconstruction, folder, overwrite=overwrite, beside=beside, photos=photos)


def moment_json(scene: SceneResult) -> str:
    """Return the text of ``moment.json``."""
    return json.dumps(moment_document(scene), indent=1) + "\n"


def moment_document(scene: SceneResult) -> dict[str, Any]:
    """Return what ``moment.json`` holds; docs/scene.md states its keys."""
    in_order = sorted(scene.photos, key=lambda photo: photo.index != scene.reference)
    photos = [
        {
            "index": photo.index,
            "people": list(photo.people),
            "reprojection_share": photo.reprojection if np.isfinite(photo.reprojection) else None,
            "scene_scale": photo.scene_scale,
        }
        for photo in in_order
    ]
    people = [
        {
            "views": list(person.views),
            "row": person.row,
            "moved": person.moved,
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
