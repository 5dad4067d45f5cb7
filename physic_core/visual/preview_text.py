"""Text of the preview: font, colours, and lines that fit a width."""

from __future__ import annotations

from functools import cache

from PIL import ImageDraw, ImageFont

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
