"""Compute input sizes of networks that keep the photo's aspect."""

from __future__ import annotations


def size_from_edges(height: int, width: int, short: int, long: int) -> tuple[int, int]:
    """Return height and width with the shorter side ``short`` px, or less if the longer side would exceed ``long`` px.

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


def size_from_target(height: int, width: int, target: tuple[int, int], multiple: int) -> tuple[int, int]:
    """Return height and width, multiples of ``multiple``, with one side of the target size.

    Of the two sides, the one that changes the photo less is taken.
    """
    scales = (target[0] / height, target[1] / width)
    scale = scales[1] if abs(1 - scales[1]) < abs(1 - scales[0]) else scales[0]
    return (
        max(multiple, round(scale * height / multiple) * multiple),
        max(multiple, round(scale * width / multiple) * multiple),
    )
