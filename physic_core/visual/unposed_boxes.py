"""Draw the people without a body as dashed boxes with the reason."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from PIL import ImageFont

if TYPE_CHECKING:
    from PIL import ImageDraw

    from physic_core.types import Reconstruction

_RGB = (255, 214, 64)
_BACKGROUND = (32, 34, 38)
_DASH_PX = 7
_FONT_PX = 12

_Box = tuple[float, float, float, float]


def unposed_boxes(reconstruction: Reconstruction) -> list[tuple[_Box, str]]:
    """Return the boxes (px of the image) and reasons of all people without a body."""
    found = [(one.box, one.reason) for one in reconstruction.unposed]
    for index, person in enumerate(reconstruction.people):
        if not np.isfinite(person.vertices).all():
            x0, y0, x1, y1 = (float(edge) for edge in person.box)
            found.append(((x0, y0, x1, y1), f"person {index}: no body"))
    return found


def draw_unposed(
    pen: ImageDraw.ImageDraw, reconstruction: Reconstruction, x: float, y: float, width: float, height: float
) -> None:
    """Draw the boxes of people without a body on a panel that shows the image at x, y, width, height px."""
    rows, columns = reconstruction.image.shape[:2]
    font = ImageFont.load_default(_FONT_PX)
    for box, reason in unposed_boxes(reconstruction):
        edges = np.array(box) * ([width / columns, height / rows] * 2)
        x0, y0, x1, y1 = np.clip(edges, 0, [width - 1, height - 1] * 2) + np.array([x, y] * 2)
        for start, end in (((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)), ((x1, y1), (x0, y1)), ((x0, y1), (x0, y0))):
            count = max(1, round(math.dist(start, end) / _DASH_PX))
            spots = np.linspace(start, end, count + 1).tolist()
            for dash in range(0, count, 2):
                pen.line((*spots[dash], *spots[dash + 1]), fill=_RGB, width=2)
        wide = font.getlength(reason)
        if wide + 4 <= x1 - x0:  # in a smaller box of a crowd, the summary names the reason
            pen.rectangle((x0 + 1, y1 - _FONT_PX - 4, x0 + wide + 5, y1 - 1), fill=_BACKGROUND)
            pen.text((x0 + 3, y1 - 3), reason, font=font, fill=_RGB, anchor="ls")
