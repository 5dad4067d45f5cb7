"""Render ``preview.png``, the picture of a reconstruction: what it is like, not why.

People without a body are dashed boxes.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw
from PIL.PngImagePlugin import PngInfo

from physic_core.files import MARK
from physic_core.types import in_words, metres_text
from physic_visual.palette import (
    FAINT,
    FLOOR_RGB,
    contact_legend,
    has_faint_contact,
)
from physic_visual.panels import (
    CONTACT_VIEWS,
    INK_RGB,
    SOFT_RGB,
    UNKNOWN_RGB,
    colored_depth,
    depth_panel,
    depth_range,
    draw_person_number,
    draw_text,
    font,
    overlay_panel,
    photo_panel,
    render_contact_views,
)
from physic_visual.person_numbers import draw_numbers, heads_in_photo
from physic_visual.views import (
    PAGE_RGB,
    LabeledView,
    build_preview_geometry,
    side_view,
    top_view,
    view_from_aside,
)

if TYPE_CHECKING:
    from physic_core.types import Reconstruction, UInt8Array
    from physic_visual.views import PreviewGeometry

_BOX_RGB = (255, 214, 64)
_DASH_PX = 7

_Box = tuple[float, float, float, float]

_WIDTH = 1280
"""Width of the preview, px."""

_MARGIN = 24
_GAP = 18
_TITLE = 30
_CELL = (_WIDTH - 2 * _MARGIN - 2 * _GAP) // 3  # width of a column, px
_DEPTH_TITLE = "Depth without people"
_FIGURE = 190  # height of a person's figures, px
_CAPTION = 48  # of the lines above them, px
_MOST_PEOPLE = 12


def draw_unposed(
    pen: ImageDraw.ImageDraw,
    reconstruction: Reconstruction,
    x: float,
    y: float,
    width: float,
    height: float,
) -> None:
    """Draw the boxes of people without a body on a panel that shows the image at x, y, width,
    height px.
    """
    rows, columns = reconstruction.image.shape[:2]
    boxes = [np.array(one.box) for one in reconstruction.unposed if one.is_missing]
    boxes += [one.box.astype(np.float64) for one in reconstruction.people if not one.has_body]
    for box in boxes:
        edges = box * ([width / columns, height / rows] * 2)
        x0, y0, x1, y1 = np.clip(edges, 0, [width - 1, height - 1] * 2) + np.array([x, y] * 2)
        _draw_dashed(pen, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)], _BOX_RGB)


def _draw_dashed(
    pen: ImageDraw.ImageDraw, corners: Sequence[tuple[float, float]], rgb: tuple[int, int, int]
) -> None:
    """Draw a closed outline through corners, px, in dashes."""
    for start, end in zip(corners, [*corners[1:], corners[0]], strict=True):
        count = max(1, round(math.dist(start, end) / _DASH_PX))
        spots = np.linspace(start, end, count + 1).tolist()
        for dash in range(0, count, 2):
            pen.line((*spots[dash], *spots[dash + 1]), fill=rgb, width=2)


@dataclass(frozen=True)
class _Frame:
    """Position and size of a panel without its title, px."""

    x: int
    y: int
    width: int
    height: int


def preview_png(reconstruction: Reconstruction) -> bytes:
    """Render the preview of a reconstruction and encode it as PNG."""
    buffer = io.BytesIO()
    note = PngInfo()
    note.add_text("Comment", MARK)
    preview_image(reconstruction).save(buffer, "PNG", compress_level=1, pnginfo=note)
    return buffer.getvalue()


def preview_image(reconstruction: Reconstruction) -> Image.Image:
    """Render photo, overlay, depth, three views, and each person's contact in one image, 1280 px
    wide, below the name of the photo.
    """
    height, width = reconstruction.image.shape[:2]
    geometry = build_preview_geometry(reconstruction)
    frames = _frame_layout(width / height, _MARGIN + 42)
    below = frames[-1].y + frames[-1].height + _GAP
    people = range(min(len(reconstruction.people), _MOST_PEOPLE))
    rows = math.ceil(len(people) / 3)
    tall = below + _TITLE + rows * (_FIGURE + _CAPTION) if rows else below
    page = Image.new("RGB", (_WIDTH, tall), PAGE_RGB)
    pen = ImageDraw.Draw(page)
    draw_text(pen, (_MARGIN, _MARGIN - 6), reconstruction.photo_name or "Reconstruction", 30)
    _draw_photo_panels(page, frames[:3], reconstruction, geometry)
    _draw_views(page, frames[3:], geometry, has_up=reconstruction.scene.level is not None)
    if rows:
        left_out = len(reconstruction.people) - len(people)
        title = f"Contact{f' ({left_out} more people not shown)' if left_out else ''}"
        draw_text(pen, (_MARGIN, below), title, 18)
        beside = _MARGIN + font(18).getlength(title) + 24
        _contact_legend(pen, (beside, below + 6), reconstruction)
    for index in people:
        row, column = divmod(index, 3)
        spot = frames[column].x, below + _TITLE + row * (_FIGURE + _CAPTION)
        _draw_person(page, spot, reconstruction, index)
    return page


def _draw_person(
    page: Image.Image, spot: tuple[int, int], reconstruction: Reconstruction, index: int
) -> None:
    """Draw number, usable marks and distance of a person, and below them front, back and soles with
    their contact.
    """
    x, y = spot
    person = reconstruction.people[index]
    pen = ImageDraw.Draw(page)
    draw_person_number(pen, x + 12, y + 12, index)
    distance = float(np.linalg.norm(person.joints[0]))
    facts = [f"{in_words(person.usable)} usable"] if person.usable else []
    if np.isfinite(distance):
        facts.append(metres_text(distance, reconstruction.distance_sigmas[index], 1))
    draw_text(pen, (x + 32, y + 12), "  ·  ".join(facts), 16, INK_RGB, "lm")
    figures = render_contact_views(reconstruction, index, _CELL, _FIGURE - 8)
    page.paste(Image.fromarray(figures), (x, y + _CAPTION))
    for column, name in enumerate(CONTACT_VIEWS):
        center_x = x + (column + 0.5) * _CELL / len(CONTACT_VIEWS)
        draw_text(pen, (center_x, y + _CAPTION - 2), name, 13, SOFT_RGB, "ms")


def _draw_photo_panels(
    page: Image.Image,
    frames: Sequence[_Frame],
    reconstruction: Reconstruction,
    geometry: PreviewGeometry,
) -> None:
    """Draw the photo, its people with numbers, and its depth."""
    import cv2

    photo, mesh, depth = frames
    size = photo.width, photo.height
    pen = ImageDraw.Draw(page)
    _draw_panel(page, photo, "Photo", photo_panel(reconstruction.image, *size))
    overlay = overlay_panel(reconstruction, geometry, *size)
    _draw_panel(page, mesh, "People over the photo", overlay)
    draw_unposed(pen, reconstruction, mesh.x, mesh.y, *size)
    draw_numbers(pen, (mesh.x, mesh.y), heads_in_photo(reconstruction, *size), size)
    depths = depth_panel(reconstruction, *size)
    _draw_panel(page, depth, _DEPTH_TITLE, depths)
    _depth_bar(page, depth, depth_range(reconstruction))
    # a pixel is not seen
    if cv2.erode((depths == UNKNOWN_RGB).all(-1).astype(np.uint8), np.ones((3, 3))).any():
        text_corner = depth.x + 6, depth.y + depth.height - 6
        draw_text(pen, text_corner, "gray: distance unknown", 13, UNKNOWN_RGB, "ls", rim=INK_RGB)


def _draw_views(
    page: Image.Image, frames: Sequence[_Frame], geometry: PreviewGeometry, *, has_up: bool
) -> None:
    """Draw people and scene at an angle, from the side and from above."""
    aside, side, above = frames
    size = aside.width, aside.height
    up = "" if has_up else " (up is the camera's)"
    _draw_panel(page, aside, "At an angle", view_from_aside(geometry, *size))
    _draw_view(page, side, f"From the side{up}", side_view(geometry, *size))
    _draw_view(page, above, "From above", top_view(geometry, *size))


_TALLEST = 540  # px, most height of a picture
_ROW = 320  # px, height of the views below


def _frame_layout(aspect: float, top: int) -> tuple[_Frame, ...]:
    """Return the frames of photo, overlay and depth in a row below a row of px, and of three views
    below them.
    """
    y = top + _TITLE
    height = min(_TALLEST, round(_CELL / aspect))
    width = max(round(height * aspect), 1)
    low = y + height + _GAP + _TITLE
    columns = [_MARGIN + i * (_CELL + _GAP) for i in range(3)]
    return (
        *(_Frame(x, y, width, height) for x in columns),
        *(_Frame(x, low, _CELL, _ROW) for x in columns),
    )


def _draw_panel(page: Image.Image, frame: _Frame, title: str, picture: UInt8Array) -> None:
    pen = ImageDraw.Draw(page)
    draw_text(pen, (frame.x, frame.y - 26), title, 18)
    page.paste(Image.fromarray(picture), (frame.x, frame.y))
    pen.rectangle(
        (frame.x - 1, frame.y - 1, frame.x + frame.width, frame.y + frame.height),
        outline=(206, 206, 202),
    )


def _depth_bar(page: Image.Image, frame: _Frame, ends: tuple[float, float]) -> None:
    """Draw the colour scale in metres, beside the panel's title."""
    pen = ImageDraw.Draw(page)
    near, far = ends
    width = min(240, int(_CELL - font(18).getlength(_DEPTH_TITLE) - 60))
    x = frame.x + _CELL - width - 20
    y = frame.y - 13
    shades = np.geomspace(near, far, width)[None].repeat(9, 0)
    page.paste(Image.fromarray(colored_depth(shades, near, far)), (x, y))
    draw_text(pen, (x, y - 4), f"{near:.2g} m", 13, anchor="lb")
    draw_text(pen, (x + width, y - 4), f"{far:.2g} m", 13, anchor="rb")


def _draw_view(page: Image.Image, frame: _Frame, title: str, plan: LabeledView) -> None:
    _draw_panel(page, frame, title, plan.picture)
    pen = ImageDraw.Draw(page, "RGBA")
    right = frame.x + frame.width
    if plan.floor_row is not None and 0 <= plan.floor_row < frame.height:
        row = frame.y + plan.floor_row
        pen.line((frame.x, row + 1, right - 1, row + 1), fill=(*FLOOR_RGB, 200), width=1)
        draw_text(pen, (right - 8, row + 3), "floor", 14, FLOOR_RGB, "ra")
    if plan.camera_px is not None:
        x = frame.x + plan.camera_px[0]
        y = frame.y + plan.camera_px[1]
        pen.ellipse((x - 5, y - 5, x + 5, y + 5), fill=INK_RGB)
        draw_text(pen, (x + 10, y - 4), "camera", 13, anchor="lm")
    scale_bar = _draw_scale_bar(pen, frame, plan.pixels_per_metre)
    crowns = {index: (column, row - 16) for index, (column, row) in plan.crowns.items()}
    draw_numbers(pen, (frame.x, frame.y), crowns, (frame.width, frame.height), [scale_bar])


def _draw_scale_bar(pen: ImageDraw.ImageDraw, frame: _Frame, pixels_per_metre: float) -> _Box:
    """Draw a scale of metres in the upper left corner of a frame, and return its box in the
    frame.
    """
    length = next((bar for bar in (1, 2, 5, 10) if bar * pixels_per_metre >= 40), 20)
    x = frame.x + 16
    y = frame.y + 28
    end = x + length * pixels_per_metre
    pen.rectangle((x - 10, y - 23, end + 10, y + 10), fill=(*PAGE_RGB, 210))
    pen.line((x, y, end, y), fill=INK_RGB, width=3)
    for edge in (x, end):
        pen.line((edge, y - 5, edge, y + 5), fill=INK_RGB, width=2)
    draw_text(pen, ((x + end) / 2, y - 5), f"{length} m", 14, anchor="mb")
    return 6, 5, end + 10 - frame.x, 38


def _contact_legend(
    pen: ImageDraw.ImageDraw, spot: tuple[float, float], reconstruction: Reconstruction
) -> None:
    """Draw name and colour of what people touch, in a line from a spot."""
    x, y = spot
    for name, color in contact_legend(reconstruction).items():
        pen.rectangle((x, y, x + 11, y + 11), fill=color)
        draw_text(pen, (x + 16, y + 6), name, 14, SOFT_RGB, "lm")
        x += 30 + font(14).getlength(name)
    if has_faint_contact(reconstruction):
        draw_text(pen, (x, y + 6), FAINT, 14, SOFT_RGB, "lm")
