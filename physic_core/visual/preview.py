"""Render ``preview.png``, an image to check the quality of a reconstruction."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from physic_core.body.joints import JOINT_INDEX
from physic_core.geometry.upright import up_in_camera
from physic_core.types import summarize_checks
from physic_core.visual.contact_colors import CONTACT_RGB, partner_legend
from physic_core.visual.orthographic_views import PAGE_RGB, LabeledView, side_view, top_view
from physic_core.visual.panels import (
    colored_depth,
    depth_panel,
    depth_range,
    overlay_panel,
    photo_panel,
    render_contact_views,
)
from physic_core.visual.preview_geometry import build_preview_geometry, person_color
from physic_core.visual.render import Perspective
from physic_core.visual.unposed_boxes import draw_unposed

if TYPE_CHECKING:
    from physic_core.types import Person, Reconstruction, UInt8Array

__all__ = ["preview_image", "preview_png", "summary_line"]

WIDTH = 1800
"""Width of the preview, px."""

MAX_CONTACT_PEOPLE = 4
"""Maximum number of people with contact views."""

_MARGIN, _GAP, _TITLE = 24, 18, 30
_ROW = 440  # height of the second row of panels, px
_CELL = 300  # room that a panel of the first row has at least, for its title and the depth's bar, px
_INK, _SOFT, _ALERT, _FLOOR = (32, 34, 38), (98, 102, 108), (178, 48, 34), (34, 140, 84)
_SHOWN_LINES = 6
_HEAD, _NECK = JOINT_INDEX["head"], JOINT_INDEX["neck"]
_DEPTH_TITLE = "Depth without people"
_PLAIN = str.maketrans({"×": "x", "—": "-", "–": "-", "−": "-", "’": "'", "‘": "'", "“": '"', "”": '"', "…": "..."})


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
    preview_image(reconstruction).save(buffer, "PNG", compress_level=2)
    return buffer.getvalue()


def preview_image(reconstruction: Reconstruction) -> Image.Image:
    """Render photo, overlay, depth, side view, top view and contacts in one image, 1800 px wide."""
    height, width = reconstruction.image.shape[:2]
    geometry = build_preview_geometry(reconstruction)
    frames = _layout(width / height)
    facts = _wrap(summary_line(reconstruction), 17, WIDTH - 2 * _MARGIN)
    lines = [
        *((line, _ALERT) for line in _message_lines("! ", reconstruction.warnings)),
        *((line, _SOFT) for line in _message_lines("", reconstruction.notes)),
    ]
    top = _MARGIN + 42 + 24 * len(facts) + 14
    bottom = max(frame.y + frame.height for frame in frames) + top
    page = Image.new("RGB", (WIDTH, bottom + _MARGIN + 24 * len(lines) + (10 if lines else 0)), PAGE_RGB)
    pen = ImageDraw.Draw(page)
    _text(pen, (_MARGIN, _MARGIN - 6), _title(reconstruction), 30, _INK)
    for line, fact in enumerate(facts):
        _text(pen, (_MARGIN, _MARGIN + 38 + 24 * line), fact, 17, _SOFT)
    photo, mesh, depth, side, above, contact = (_Frame(f.x, f.y + top, f.width, f.height) for f in frames)
    _draw_panel(page, photo, "Photo", photo_panel(reconstruction.image, photo.width, photo.height))
    _draw_panel(page, mesh, "People over the photo", overlay_panel(reconstruction, geometry, mesh.width, mesh.height))
    draw_unposed(pen, reconstruction, mesh.x, mesh.y, mesh.width, mesh.height)
    _name_people(pen, mesh, reconstruction)
    _draw_panel(page, depth, _DEPTH_TITLE, depth_panel(reconstruction, depth.width, depth.height))
    _depth_bar(page, depth, depth_range(reconstruction))
    up = "" if reconstruction.scene.floor else " (no floor found: up is the camera's)"
    _draw_view(page, side, f"From the side{up}", side_view(geometry, side.width, side.height))
    _draw_view(page, above, "From above", top_view(geometry, above.width, above.height))
    _draw_contact_panel(page, contact, reconstruction)
    for row, (text, color) in enumerate(lines):
        _text(pen, (_MARGIN, bottom + 14 + 24 * row), text, 16, color)
    return page


def summary_line(reconstruction: Reconstruction) -> str:
    """Return one line of text with grade, size, focal length, scale, floor, time and checks of a reconstruction."""
    camera, scene = reconstruction.intrinsics, reconstruction.scene
    facts = [
        f"grade: {reconstruction.grade or 'none'}",
        f"{camera.width} x {camera.height} px",
        f"focal length {math.sqrt(camera.fx * camera.fy):.0f} px ({camera.source})",
        "scale of unknown certainty" if scene.scale_sigma is None else f"scale ±{100 * scene.scale_sigma:.0f} %",
        *([f"changed by {100 * (scene.scale - 1):+.1f} % in the joint fit"] if reconstruction.people else []),
    ]
    if scene.floor is None:
        facts.append("no floor found")
    else:
        pitch = math.degrees(math.asin(float(np.clip(-up_in_camera(scene.floor)[2], -1.0, 1.0))))
        way = "down" if pitch >= 0 else "up"
        facts.append(f"camera {scene.floor.offset:.2f} m above the floor, looking {abs(pitch):.0f}° {way}")
    seconds = sum(stage.seconds for stage in reconstruction.stages)
    if seconds:
        facts.append(f"{seconds:.1f} s")
    facts.append(f"checks: {summarize_checks(reconstruction.checks)}")
    count = len(reconstruction.warnings)
    facts.append(f"{count} warning{'' if count == 1 else 's'}" if count else "no warnings")
    return "  ·  ".join(facts)


def person_checks(person: Person) -> str:
    """Return the names of a person's checks that failed or were not measured, as one line; "" if all are ok."""
    parts = [f"fails: {', '.join(person.failed_checks)}"] * bool(person.failed_checks)
    parts += [f"not measured: {', '.join(person.unknown_checks)}"] * bool(person.unknown_checks)
    return "; ".join(parts)


def _title(reconstruction: Reconstruction) -> str:
    people, unposed = len(reconstruction.people), len(reconstruction.unposed)
    found = {0: "No person: the scene alone", 1: "1 person"}.get(people, f"{people} people")
    return f"{found}, {unposed} without a body" if unposed else found


def _layout(aspect: float) -> tuple[_Frame, ...]:
    """Return the frames of photo, overlay, depth, side, top and contact panels."""
    room = WIDTH - 2 * _MARGIN
    third = (room - 2 * _GAP) // 3
    if aspect > 1.05:
        height = round(third / aspect)
        sizes = [[(third, height)] * 3, [(third, _ROW)] * 3]
    else:
        # An upright photo leaves room for the side view beside the three pictures.
        height = min(600, round((room - 3 * _GAP - 420) / (3 * aspect)))
        width = max(1, round(height * aspect))
        sizes = [
            [(width, height)] * 3 + [(room - 3 * (max(width, _CELL) + _GAP), height)],
            [(third, _ROW), (room - third - _GAP, _ROW)],
        ]
    frames, y = [], 0
    for row in sizes:
        x = _MARGIN
        for width, height in row:
            frames.append(_Frame(x, y + _TITLE, width, height))
            x += max(width, _CELL) + _GAP
        y += _TITLE + row[0][1] + _GAP
    return tuple(frames)


def _draw_panel(page: Image.Image, frame: _Frame, title: str, picture: UInt8Array) -> None:
    pen = ImageDraw.Draw(page)
    _text(pen, (frame.x, frame.y - 26), title, 18, _INK)
    page.paste(Image.fromarray(picture), (frame.x, frame.y))
    pen.rectangle((frame.x - 1, frame.y - 1, frame.x + frame.width, frame.y + frame.height), outline=(206, 206, 202))


def _name_people(pen: ImageDraw.ImageDraw, frame: _Frame, reconstruction: Reconstruction) -> None:
    """Draw each person's number above their head, or beside it at the top edge of the photo."""
    camera = Perspective(reconstruction.intrinsics, frame.width, frame.height)
    for index, person in enumerate(reconstruction.people):
        spots = camera.project(np.asarray(person.joints[[_HEAD, _NECK]], np.float64))
        column, row = spots[0, :2]
        top = float(person.box[1]) * frame.height / reconstruction.image.shape[0] - 14
        if not np.isfinite([column, row, top]).all():
            continue
        if top < 12:
            aside = max(28.0, 1.6 * float(np.linalg.norm(spots[0, :2] - spots[1, :2])))
            column, top = column + (aside if column + aside < frame.width - 12 else -aside), max(row - 6, 12)
        x, y = (float(np.clip(value, 12, size - 12)) for value, size in ((column, frame.width), (top, frame.height)))
        _draw_person_number(pen, frame.x + x, frame.y + y, index)


def _draw_person_number(pen: ImageDraw.ImageDraw, x: float, y: float, index: int) -> None:
    """Draw a person's number on a disc in their colour."""
    pen.ellipse((x - 11, y - 11, x + 11, y + 11), fill=person_color(index), outline=(255, 255, 255), width=2)
    pen.text((x, y), str(index), font=_font(14), fill=(20, 20, 20), anchor="mm")


def _depth_bar(page: Image.Image, frame: _Frame, ends: tuple[float, float]) -> None:
    """Draw the colour scale in metres, beside the panel's title."""
    pen = ImageDraw.Draw(page)
    near, far = ends
    room = max(frame.width, _CELL)
    width = min(240, int(room - _font(18).getlength(_DEPTH_TITLE) - 60))
    x, y = frame.x + room - width - 20, frame.y - 13
    shades = np.geomspace(near, far, width)[None].repeat(9, 0)
    page.paste(Image.fromarray(colored_depth(shades, near, far)), (x, y))
    last = -math.inf
    for metres in _ticks(near, far):
        column = x + math.log(metres / near) / math.log(far / near) * width
        if column > last + 26:
            last = column
            pen.line((column, y - 3, column, y), fill=_SOFT)
            pen.text((column, y - 4), f"{metres:g}", font=_font(13), fill=_INK, anchor="mb")
    pen.text((x + width + 6, y + 9), "m", font=_font(14), fill=_INK, anchor="ls")


def _draw_view(page: Image.Image, frame: _Frame, title: str, plan: LabeledView) -> None:
    _draw_panel(page, frame, title, plan.picture)
    pen = ImageDraw.Draw(page, "RGBA")
    bottom = frame.y + frame.height
    if plan.floor_row is not None and 0 <= plan.floor_row < frame.height:
        row = frame.y + plan.floor_row
        pen.line((frame.x, row + 1, frame.x + frame.width - 1, row + 1), fill=(*_FLOOR, 200), width=1)
        pen.text((frame.x + frame.width - 8, row + 3), "floor", font=_font(14), fill=_FLOOR, anchor="ra")
    if plan.camera is not None:
        _draw_camera(pen, frame, plan)
    for metre, column in plan.columns.items():
        if 6 < column < frame.width - 6 and (plan.pixels_per_metre > 30 or metre % 5 == 0):
            pen.line((frame.x + column, bottom - 8, frame.x + column, bottom - 1), fill=_SOFT)
            pen.text((frame.x + column, bottom - 9), f"{metre} m", font=_font(13), fill=_INK, anchor="mb")
    length = next((bar for bar in (1, 2, 5, 10) if bar * plan.pixels_per_metre >= 40), 20)
    x, y = frame.x + 16, frame.y + 28
    end = x + length * plan.pixels_per_metre
    pen.rectangle((x - 10, y - 23, end + 10, y + 10), fill=(*PAGE_RGB, 210))
    pen.line((x, y, end, y), fill=_INK, width=3)
    for edge in (x, end):
        pen.line((edge, y - 5, edge, y + 5), fill=_INK, width=2)
    pen.text(((x + end) / 2, y - 5), f"{length} m", font=_font(14), fill=_INK, anchor="mb")


def _draw_camera(pen: ImageDraw.ImageDraw, frame: _Frame, plan: LabeledView) -> None:
    """Draw a camera symbol; it looks to the right in the side view, to the top in the top view."""
    assert plan.camera is not None
    x, y = frame.x + plan.camera[0], frame.y + plan.camera[1]
    sideways = bool(plan.columns)
    along, beside = (
        (np.array([1.0, 0.0]), np.array([0.0, 1.0])) if sideways else (np.array([0, -1.0]), np.array([1.0, 0]))
    )

    def quad(start: float, end: float, first: float, second: float) -> list[tuple[float, float]]:
        corners = ((start, -first), (start, first), (end, second), (end, -second))
        return [tuple((np.array([x, y]) + a * along + b * beside).tolist()) for a, b in corners]

    pen.polygon(quad(-16, 0, 8, 8), fill=_INK)
    pen.polygon(quad(1, 8, 3, 7), fill=_INK)
    anchor, spot = ("mt", (x - 4, y + 12)) if sideways else ("lm", (x + 14, y + 8))
    pen.text(spot, "camera", font=_font(13), fill=_INK, anchor=anchor)


def _draw_contact_panel(page: Image.Image, frame: _Frame, reconstruction: Reconstruction) -> None:
    pen = ImageDraw.Draw(page)
    people = reconstruction.people
    shown = min(len(people), MAX_CONTACT_PEOPLE)
    more = f", {len(people) - shown} more not shown" if len(people) > shown else ""
    title = f"Contact{more}"
    _text(pen, (frame.x, frame.y - 26), title, 18, _INK)
    _contact_legend(pen, frame, frame.x + _font(18).getlength(title) + 20, reconstruction)
    pen.rectangle((frame.x - 1, frame.y - 1, frame.x + frame.width, frame.y + frame.height), outline=(206, 206, 202))
    if not shown:
        return
    across, down = _grid(shown, frame)
    width, height = frame.width // across, frame.height // down
    head = 50 if any(person_checks(person) for person in people[:shown]) else 30
    for index in range(shown):
        x, y = frame.x + index % across * width, frame.y + index // across * height
        shown_person = render_contact_views(reconstruction, index, width - 8, height - head - 24)
        page.paste(Image.fromarray(shown_person.picture), (x + 4, y + head))
        for view, column in shown_person.views:
            pen.text((x + 4 + column, y + height - 12), view, font=_font(13), fill=_SOFT, anchor="mm")
        _draw_person_number(pen, x + 18, y + 16, index)
        person = people[index]
        share = 100 * float(np.mean(person.contact)) if len(person.contact) else 0.0
        grade = f"{person.grade}, " if person.grade else ""
        parts = "; ".join(map(str, person.contacts)) or "no contact"
        facts = _shorten(f"{grade}{share:.1f} % of the vertices touch. {parts}", 15, width - 44)
        pen.text((x + 36, y + 16), facts, font=_font(15), fill=_SOFT, anchor="lm")
        if line := person_checks(person):
            line = _shorten(line, 14, width - 16)
            color = _ALERT if person.failed_checks else _SOFT
            pen.text((x + 8, y + 38), line, font=_font(14), fill=color, anchor="lm")


def _contact_legend(pen: ImageDraw.ImageDraw, frame: _Frame, x: float, reconstruction: Reconstruction) -> None:
    """Draw name and colour of what people touch, beside the panel's title."""
    known = any(person.contact_partner is not None for person in reconstruction.people)
    legend = partner_legend(reconstruction.contact_partners) if known else {"in contact": CONTACT_RGB}
    font = _font(14)
    for name, color in legend.items():
        end = x + 16 + font.getlength(name)
        if end > frame.x + frame.width:
            return
        pen.rectangle((x, frame.y - 20, x + 11, frame.y - 9), fill=color)
        pen.text((x + 16, frame.y - 14), name, font=font, fill=_SOFT, anchor="lm")
        x = end + 14


def _grid(count: int, frame: _Frame) -> tuple[int, int]:
    """Return the number of columns and rows that show ``count`` people as large as possible."""

    def scale(across: int) -> float:
        return min(frame.width / across / 2.6, (frame.height / math.ceil(count / across) - 54) / 1.8)

    across = max(range(1, count + 1), key=scale)
    return across, math.ceil(count / across)


def _message_lines(mark: str, texts: Sequence[str]) -> list[str]:
    lines = [_shorten(f"{mark}{text}", 16, WIDTH - 2 * _MARGIN) for text in texts[:_SHOWN_LINES]]
    more = len(texts) - len(lines)
    return [*lines, f"{mark}{more} more in reconstruction.json"] if more > 0 else lines


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _text(
    pen: ImageDraw.ImageDraw, spot: tuple[float, float], text: str, size: int, color: tuple[int, int, int]
) -> None:
    pen.text(spot, text.translate(_PLAIN), font=_font(size), fill=color)


def _shorten(text: str, size: int, width: float) -> str:
    """Shorten a text to one line of at most ``width`` px."""
    line = " ".join(text.translate(_PLAIN).split())
    font = _font(size)
    if font.getlength(line) <= width:
        return line
    while line and font.getlength(line + " ...") > width:
        line = line[:-8]
    return line + " ..."


def _wrap(text: str, size: int, width: float) -> list[str]:
    """Join facts to as few lines as possible, each at most ``width`` px."""
    font, lines = _font(size), [""]
    for fact in text.split("  ·  "):
        longer = f"{lines[-1]}  ·  {fact}" if lines[-1] else fact
        if font.getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(fact)
    return lines


def _ticks(near: float, far: float) -> list[float]:
    """Return round depths between two depths in metres: 1, 2, 5, 10, ..., with more values if these are few."""
    powers = [10.0**power for power in range(math.floor(math.log10(near)), math.ceil(math.log10(far)) + 1)]
    for factors in ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7), tuple(1 + step / 10 for step in range(90))):
        ticks = [power * factor for power in powers for factor in factors if near <= power * factor <= far]
        if len(ticks) >= 3:
            break
    return ticks
