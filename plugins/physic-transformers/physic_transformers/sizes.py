"""To which size a photo is brought for a network that wants its proportions kept."""

from __future__ import annotations

__all__ = ["between_edges", "least_change"]


def between_edges(height: int, width: int, short: int, long: int) -> tuple[int, int]:
    """Height and width so that the shorter side is ``short`` px, or less where the longer one would exceed ``long``.

    Sides are cut to whole pixels as DETR and its descendants were trained.
    """
    low, high = min(height, width), max(height, width)
    edge: float = short
    if high / low * short > long:
        edge = long * low / high
    side = round(edge)
    if low == side:
        return height, width
    other = max(1, int(edge * high / low))
    side = max(1, side)
    return (side, other) if height <= width else (other, side)


def least_change(height: int, width: int, target: tuple[int, int], multiple: int) -> tuple[int, int]:
    """Height and width, multiples of ``multiple``, of which one is the target's: that which changes the photo less."""
    scales = (target[0] / height, target[1] / width)
    scale = scales[1] if abs(1 - scales[1]) < abs(1 - scales[0]) else scales[0]
    return (
        max(multiple, round(scale * height / multiple) * multiple),
        max(multiple, round(scale * width / multiple) * multiple),
    )
