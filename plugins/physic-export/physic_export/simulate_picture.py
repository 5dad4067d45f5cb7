"""A picture of people before and after a simulation, by ray casting: it needs no display."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from physic_core.files.own import MARK
from physic_core.visual.palette import FLOOR_RGB, person_color
from physic_core.visual.render import View, composite, prepare_meshes, render_mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_export.simulate import Motion

_SIDE_PX, _SIDE_M = 320, 2.2
_VIEW = np.deg2rad(30.0)  # from the camera's direction, so that a fall towards the camera is seen


def draw_motions(motions: Sequence[Motion], seconds: float) -> bytes:
    """Return a PNG with a row for each person: at the start and at the end, with the floor as a line."""
    from PIL import Image, ImageDraw
    from PIL.PngImagePlugin import PngInfo

    page = Image.new("RGB", (2 * _SIDE_PX, _SIDE_PX * max(len(motions), 1)), "white")
    draw = ImageDraw.Draw(page)
    for row, motion in enumerate(motions):
        for column, vertices in enumerate((motion.start, motion.end)):
            corner = column * _SIDE_PX, row * _SIDE_PX
            page.paste(Image.fromarray(_draw(vertices, motion)), corner)
            words = f"person {motion.person}, start" if column == 0 else f"after {seconds:g} s: "
            if column:
                words += "stays" if motion.stays else f"moved {100 * motion.moved_m:.0f} cm"
            draw.text((corner[0] + 8, corner[1] + 6), words, fill="black")
    buffer, note = io.BytesIO(), PngInfo()
    note.add_text("Comment", MARK)
    page.save(buffer, "PNG", optimize=True, pnginfo=note)
    return buffer.getvalue()


def _draw(vertices: NDArray[np.float64], motion: Motion) -> NDArray[np.uint8]:
    center = (motion.start.min(0) + motion.start.max(0)) / 2
    right = np.array([np.cos(_VIEW), np.sin(_VIEW), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    axes = np.stack([right, up, np.cross(right, up)])
    camera = View.orthographic(axes, center, _SIDE_PX / _SIDE_M, (_SIDE_PX, _SIDE_PX))
    picture = np.full((_SIDE_PX, _SIDE_PX, 3), 0.97, np.float32)
    floor = round(float(camera.project(np.array([[center[0], center[1], 0.0]]))[0, 1]))
    picture[max(floor, 0) : max(floor, 0) + 2] = np.array(FLOOR_RGB) / 255
    mesh = prepare_meshes([vertices], motion.faces)
    if mesh is not None:
        colors = np.tile(np.array(person_color(motion.person)) / 255, (len(vertices), 1))
        picture = composite(render_mesh(mesh, camera, colors), picture)
    return np.round(255 * picture).astype(np.uint8)
