"""The table of the preview: each person's contact, grade, distance, and the checks that the grade comes from.

Font, colours and wrapped lines are those of the whole preview.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from physic_core.types import Grade
from physic_core.types.metres_text import metres_text
from physic_core.visual.orthographic_views import PAGE_RGB
from physic_core.visual.palette import person_color
from physic_core.visual.panels import CONTACT_VIEWS, render_contact_views

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

    Line = tuple[str, tuple[int, int, int]]

INK_RGB, SOFT_RGB, ALERT_RGB = (32, 34, 38), (98, 102, 108), (178, 48, 34)

# The font has none of these.
_PLAIN = str.maketrans({"×": "x", "—": "-", "–": "-", "−": "-", "’": "'", "‘": "'", "“": '"', "”": '"', "…": "..."})


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font of the preview, size in px."""
    return ImageFont.load_default(size)


def draw_text(
    pen: ImageDraw.ImageDraw, spot: tuple[float, float], text: str, size: int, color: tuple[int, int, int] = INK_RGB
) -> None:
    """Draw one line of text with its upper left corner at a spot, px."""
    pen.text(spot, text.translate(_PLAIN), font=font(size), fill=color)


def wrap(text: str, size: int, width: float, between: str = " ") -> list[str]:
    """Break a text at ``between`` into as few lines as possible, each at most ``width`` px unless one word is wider."""
    lines: list[str] = []
    for word in text.translate(_PLAIN).split(between):
        longer = f"{lines[-1]}{between}{word}" if lines else word
        if lines and font(size).getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


MAX_PEOPLE = 16
"""Maximum number of people with a row."""

_TEXT, _LINE, _HEAD, _PAD = 15, 21, 26, 10  # px: size of the text, height of a line, of the head, space in a row
_NUMBER, _GRADE, _DISTANCE = 40, 96, 128  # widths of columns, px
_GRADE_RGB = {Grade.GOOD: (28, 122, 70), Grade.DOUBTFUL: (150, 96, 10), Grade.BAD: ALERT_RGB}
_RULE_RGB = (206, 206, 202)


def people_table(reconstruction: Reconstruction, width: int) -> Image.Image:
    """Draw a row for each person, up to :data:`MAX_PEOPLE`; nothing in it is shortened.

    Args:
        reconstruction: with people.
        width: of the table, px.
    """
    people = range(min(len(reconstruction.people), MAX_PEOPLE))
    tall = int(np.clip(500 / len(people), 100, 200))  # px of the figures
    figures = 2 * tall
    free = width - figures - _NUMBER - _GRADE - _DISTANCE
    columns = np.cumsum([0, _NUMBER, figures, _GRADE, _DISTANCE, 0.45 * free]).tolist()
    names = ("", "", "grade", "distance", "touches (probability)", "why")
    rooms = [end - start - 28 for start, end in zip(columns, [*columns[1:], width], strict=True)]
    rows = [_cells(reconstruction, index, rooms[4], rooms[5]) for index in people]
    heights = [max(tall, _LINE * max(map(len, row))) + _PAD for row in rows]
    left_out = len(reconstruction.people) - len(people)
    table = Image.new("RGB", (width, _HEAD + sum(heights) + (_LINE if left_out else 0)), PAGE_RGB)
    pen = ImageDraw.Draw(table)
    for name, x in zip(names, columns, strict=True):
        draw_text(pen, (x, 2), name, _TEXT, SOFT_RGB)
    for place, name in enumerate(CONTACT_VIEWS):
        middle = columns[1] + (place + 0.5) * (figures - 16) / len(CONTACT_VIEWS)
        pen.text((middle, 2), name, font=font(_TEXT), fill=SOFT_RGB, anchor="ma")
    top = _HEAD
    for index, cells, height in zip(people, rows, heights, strict=True):
        pen.line((0, top, width, top), fill=_RULE_RGB)
        draw_person_number(pen, 16, top + 20, index)
        picture = render_contact_views(reconstruction, index, figures - 16, height - _PAD)
        table.paste(Image.fromarray(picture), (int(columns[1]), top + _PAD // 2))
        for x, lines in zip(columns[2:], cells, strict=True):
            for number, (text, color) in enumerate(lines):
                draw_text(pen, (x, top + 8 + _LINE * number), text, _TEXT, color)
        top += height
    if left_out:
        draw_text(pen, (0, top), f"{left_out} more people: see report.html or reconstruction.json", _TEXT, SOFT_RGB)
    return table


def draw_person_number(pen: ImageDraw.ImageDraw, x: float, y: float, index: int) -> None:
    """Draw a person's number on a disc in their colour."""
    pen.ellipse((x - 11, y - 11, x + 11, y + 11), fill=person_color(index), outline=(255, 255, 255), width=2)
    pen.text((x, y), str(index), font=font(14), fill=(20, 20, 20), anchor="mm")


def _cells(reconstruction: Reconstruction, index: int, touch_px: float, why_px: float) -> list[list[Line]]:
    """Return the lines of grade, distance, contact and reasons, each with its colour."""
    person = reconstruction.people[index]
    distance, sigma = float(np.linalg.norm(person.joints[0])), reconstruction.distance_sigmas[index]
    likely = "; ".join(str(contact) for contact in person.contacts if contact.likely and not contact.assumed)
    assumed = "; ".join(str(contact) for contact in person.contacts if contact.likely and contact.assumed)
    possible = "; ".join(str(contact) for contact in person.contacts if not contact.likely)
    touches: list[Line] = []
    if likely:
        touches.append((likely, INK_RGB))
    if assumed:
        touches.append((assumed, SOFT_RGB))
    if possible:
        touches.append((f"possible: {possible}", SOFT_RGB))
    if not touches:
        touches = [(f"{np.sum(person.contact)} of {len(person.contact)} vertices", SOFT_RGB)]
    checks = [check for check in reconstruction.checks if check.person == index]
    why = [(str(check), ALERT_RGB) for check in checks if check.failed]
    unknown = "; ".join(check.title for check in checks if not check.failed and not check.ok)
    if unknown:
        why.append((f"not measured: {unknown}", SOFT_RGB))
    return [
        [(person.grade or "none", INK_RGB if person.grade is None else _GRADE_RGB[person.grade])],
        _wrapped([(metres_text(distance, sigma, 1) if np.isfinite(distance) else "unknown", INK_RGB)], _DISTANCE - 16),
        _wrapped(touches, touch_px),
        _wrapped(why or [("all checks are ok" if checks else "no checks were run", SOFT_RGB)], why_px),
    ]


def _wrapped(texts: list[Line], width: float) -> list[Line]:
    return [(line, color) for text, color in texts for line in wrap(text, _TEXT, width)]
