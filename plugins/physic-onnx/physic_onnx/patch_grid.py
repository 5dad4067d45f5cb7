"""Input sizes for vision transformers: multiples of the patch size, with nearly the photo's aspect."""

from __future__ import annotations

import math


def input_size_least_scaling(height: int, width: int, side: int, patch: int = 14) -> tuple[int, int]:
    """Return the input size of DPT and Depth Anything: ``side`` px for the image side that needs less scaling.

    For a photo larger than ``side``, this is the short side; for a smaller one, the long side.

    Args:
        height: of the photo, px.
        width: of the photo, px.
        side: px, a multiple of ``patch``.
        patch: px.

    Returns:
        Rows and columns, px, each the nearest multiple of ``patch`` and at least one patch.
    """
    tall, wide = side / height, side / width
    scale = wide if abs(1 - wide) < abs(1 - tall) else tall
    return _nearest(scale * height, patch), _nearest(scale * width, patch)


def input_size_by_long_side(height: int, width: int, side: int, patch: int = 14) -> tuple[int, int]:
    """Return the input size of Depth Anything 3: long side ``side`` px, both sides rounded to multiples of ``patch``.

    Args:
        height: of the photo, px.
        width: of the photo, px.
        side: px.
        patch: px; both sides are multiples of it.
    """
    scale = side / max(height, width)
    rows, columns = max(1, round(height * scale)), max(1, round(width * scale))
    return _nearest_or_up(rows, patch), _nearest_or_up(columns, patch)


def limit_patches(rows: int, columns: int, most: int, patch: int = 14) -> tuple[int, int]:
    """Reduce an input size to at most ``most`` patches, keeping about the same aspect.

    Time and memory of a transformer grow with the square of the number of patches.
    """
    patches = (rows // patch) * (columns // patch)
    if patches <= most:
        return rows, columns
    scale = math.sqrt(most / patches)
    return max(1, int(rows * scale) // patch) * patch, max(1, int(columns * scale) // patch) * patch


def _nearest(value: float, patch: int) -> int:
    """Round to the nearest multiple of the patch size, at least one patch."""
    return max(1, round(value / patch)) * patch


def _nearest_or_up(value: int, patch: int) -> int:
    """Round to the nearest multiple of the patch size, ties up, at least one patch."""
    return max(1, (2 * value + patch) // (2 * patch)) * patch
