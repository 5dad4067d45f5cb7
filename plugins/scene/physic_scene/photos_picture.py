"""``photos.png``: each photo of a moment, and the people over it as its camera sees them."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw

from physic_core.body import JOINT_INDEX
from physic_visual.panels import bodies_over, draw_person_number, draw_text, photo_panel
from physic_visual.render import View
from physic_visual.views import PAGE_RGB, build_preview_geometry

if TYPE_CHECKING:
    from physic_core.types import Reconstruction
    from physic_scene.types import SceneResult, SolvedPhoto
    from physic_visual.views import PreviewGeometry

_HEIGHT = 440  # px, of a photo
_MARGIN = 24  # px, around it
_TITLE = 30  # px, of its name


def photos_png(scene: SceneResult) -> bytes:
    """Draw a row for each photo, the reference first, and encode them as PNG."""
    result = scene.reconstruction
    geometry = build_preview_geometry(result)
    photos = sorted(scene.photos, key=lambda one: one.index != scene.reference)
    rows = [_photo_row(photo, result, geometry) for photo in photos]
    page = Image.new(
        "RGB", (max(row.width for row in rows), sum(row.height for row in rows)), PAGE_RGB
    )
    for number, row in enumerate(rows):
        page.paste(row, (0, number * row.height))
    buffer = io.BytesIO()
    page.save(buffer, "PNG", compress_level=2)
    return buffer.getvalue()


def _photo_row(
    photo: SolvedPhoto, result: Reconstruction, geometry: PreviewGeometry
) -> Image.Image:
    """Draw a photo, and beside it the people of a result, over the photo."""
    image = photo.result.image
    camera = photo.camera
    width = max(1, round(_HEIGHT * image.shape[1] / image.shape[0]))
    plain = photo_panel(image, width, _HEIGHT)
    view = replace(
        View.perspective(camera.intrinsics, width, _HEIGHT),
        axes=camera.rotation.astype(np.float64),
        origin=camera.centre.astype(np.float64),
    )
    row = Image.new("RGB", (2 * width + 3 * _MARGIN, _HEIGHT + _TITLE + _MARGIN), PAGE_RGB)
    row.paste(Image.fromarray(plain), (_MARGIN, _TITLE))
    over = bodies_over(plain, view, geometry)
    row.paste(Image.fromarray(over), (width + 2 * _MARGIN, _TITLE))
    pen = ImageDraw.Draw(row)
    shift = np.linalg.norm(camera.centre)
    where = (
        f"{shift:.2f} m ±{camera.position_sigma:.2f} m from the first camera"
        if shift
        else "the first camera"
    )
    draw_text(pen, (_MARGIN, 4), f"{photo.name}: {where}", 18)
    for index in photo.shown:
        head = result.people[index].joints[[JOINT_INDEX["head"]]].astype(np.float64)
        column, line, _ = view.project(head)[0]
        if np.isfinite([column, line]).all():
            x = np.clip(column, 12, width - 12)
            y = np.clip(line, 12, _HEIGHT - 12)
            draw_person_number(pen, width + 2 * _MARGIN + float(x), _TITLE + float(y), index)
    return row
