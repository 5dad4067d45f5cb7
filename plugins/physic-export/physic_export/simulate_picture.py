"""A picture of people before and after a simulation, on what carries them, by ray casting: it needs no display."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from physic_core.files.own import MARK
from physic_core.geometry.upright import transform_points
from physic_core.visual.palette import person_color
from physic_core.visual.render import View, blend_over, prepare_meshes, render_mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_export.simulate import Motion
    from physic_export.tiles import Tile

    Array = NDArray[np.float64]
    Mesh = tuple[Array, NDArray[np.int64], Array]
    """Vertices (V, 3), faces (F, 3) and sRGB colours (V, 3) in 0-1."""

_SIDE_PX, _SIDE_M = 320, 2.2
_AZIMUTH, _ELEVATION = np.deg2rad(30.0), np.deg2rad(12.0)
"""Of the view, from the camera's direction, so that a fall towards the camera is seen, and from above, as the floor."""

_CELL_M, _CELLS = 0.25, 12
_FLOOR_GREYS = (0.86, 0.8)
_COVERED = 0.5
"""Opacity of people behind a part of the scene, which would hide them."""


def draw_motions(
    motions: Sequence[Motion], seconds: float, tiles: Sequence[Tile], matrix: NDArray[np.float64]
) -> bytes:
    """Return a PNG with a row for each person: at the start and at the end, on floor and scene.

    Args:
        motions: of people.
        seconds: simulated time.
        tiles: collision meshes of the scene.
        matrix: (4, 4) from the camera frame to that of the motions, z up.
    """
    from PIL import Image, ImageDraw
    from PIL.PngImagePlugin import PngInfo

    page = Image.new("RGB", (2 * _SIDE_PX, _SIDE_PX * max(len(motions), 1)), "white")
    draw = ImageDraw.Draw(page)
    placed = [(transform_points(matrix, tile.vertices), tile.faces, tile.color) for tile in tiles]
    for row, motion in enumerate(motions):
        ground = _ground(motion, placed)
        for column, vertices in enumerate((motion.start, motion.end)):
            corner = column * _SIDE_PX, row * _SIDE_PX
            page.paste(Image.fromarray(_draw(vertices, motion, ground)), corner)
            words = f"person {motion.person}, {motion.posture}"
            if column:
                words = f"after {seconds:g} s: {motion.outcome}"
                words += "" if motion.stays else f", {100 * motion.moved_m:.0f} cm"
            draw.text((corner[0] + 8, corner[1] + 6), words, fill="black")
    buffer, note = io.BytesIO(), PngInfo()
    note.add_text("Comment", MARK)
    page.save(buffer, "PNG", optimize=True, pnginfo=note)
    return buffer.getvalue()


def _ground(motion: Motion, tiles: Sequence[Mesh]) -> Mesh:
    """Return the floor as a chequered square around a person, with the tiles over it."""
    half = _CELL_M * _CELLS / 2
    center = np.round(motion.start[:, :2].mean(0) / _CELL_M) * _CELL_M
    near = [tile for tile in tiles if (np.abs(tile[0][:, :2] - center) < half).all()]
    rows, columns = np.indices((_CELLS, _CELLS)).reshape(2, -1)
    corner = np.stack([columns, rows, 0 * rows], 1) * _CELL_M - [half, half, 0] + [*center, 0]
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * _CELL_M
    cells = (corner[:, None] + square).reshape(-1, 3)
    faces = (4 * np.arange(len(corner))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    grey = np.repeat(np.array(_FLOOR_GREYS)[(rows + columns) % 2], 4)
    meshes: list[Mesh] = [(cells, faces, np.tile(grey[:, None], 3))]
    meshes += [(vertices, faces, np.tile(color, (len(vertices), 1))) for vertices, faces, color in near]
    starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in meshes)])
    joined = [own + start for (_, own, _), start in zip(meshes, starts, strict=False)]
    return (
        np.concatenate([vertices for vertices, _, _ in meshes]),
        np.concatenate(joined),
        np.concatenate([colors for _, _, colors in meshes]),
    )


def _draw(vertices: Array, motion: Motion, ground: Mesh) -> NDArray[np.uint8]:
    both = np.concatenate([motion.start, motion.end])
    low, high = both.min(0), both.max(0)
    right = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
    level = np.cross(right, [0.0, 0.0, 1.0])
    eye = np.cos(_ELEVATION) * level + np.sin(_ELEVATION) * np.array([0.0, 0.0, 1.0])
    axes = np.stack([right, np.cross(eye, right), eye])
    side = max(_SIDE_M, 1.1 * float((high - low).max()))
    camera = View.orthographic(axes, (low + high) / 2, _SIDE_PX / side, (_SIDE_PX, _SIDE_PX))
    picture = np.full((_SIDE_PX, _SIDE_PX, 3), 0.97, np.float32)
    below = prepare_meshes([ground[0]], ground[1])
    body = prepare_meshes([vertices], motion.faces)
    if below is None or body is None:
        return np.round(255 * picture).astype(np.uint8)
    scene = render_mesh(below, camera, ground[2])
    picture = blend_over(scene, picture)
    person = render_mesh(body, camera, np.tile(np.array(person_color(motion.person)) / 255, (len(vertices), 1)))
    covered = (scene.distance < person.distance)[..., None]
    picture = np.where(covered, blend_over(person, picture, _COVERED), blend_over(person, picture))
    return np.round(255 * picture).astype(np.uint8)
