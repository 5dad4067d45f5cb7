"""Thumbnails of the photos of a batch: the people over the photo, and the side view."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.files.atomic import MARK, write_own

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

_HEIGHT = 180  # px of a thumbnail: photo with people, and side view

_NARROWEST, _WIDEST, _SIDE_VIEW = 1 / 3, 16 / 9, 11 / 9
"""Width over height of the narrowest and the widest photo, and of the side view."""


def thumbnail_path(folder: str) -> str:
    """Return the path of a thumbnail in the output folder for a photo's folder "photos/3f/NAME"."""
    return f"thumbnails/{folder.removeprefix('photos/')}.jpg"


def write_thumbnail(result: Reconstruction, out: Path, folder: str) -> Path:
    """Write the thumbnail of a photo as one small JPEG of 180 px height, and return its path.

    Args:
        result: of the photo.
        out: folder of the batch.
        folder: of the photo, relative to ``out``.

    Raises:
        OutputError: it cannot be written.
    """
    return write_own(out / thumbnail_path(folder), thumbnail_jpeg(result, _HEIGHT))


def thumbnail_jpeg(result: Reconstruction, height: int) -> bytes:
    """Return the people over the photo, and the side view, as one JPEG of a height in px."""
    import numpy as np
    from PIL import Image

    from physic_core.visual.orthographic_views import build_preview_geometry, side_view
    from physic_core.visual.panels import overlay_panel

    geometry = build_preview_geometry(result)
    aspect = result.image.shape[1] / result.image.shape[0]
    wide = round(height * max(_NARROWEST, min(_WIDEST, aspect)))
    panels: Sequence[object] = (
        overlay_panel(result, geometry, wide, height),
        side_view(geometry, round(_SIDE_VIEW * height), height).picture,
    )
    buffer = io.BytesIO()
    Image.fromarray(np.concatenate([np.asarray(panel)[:height] for panel in panels], axis=1)).save(
        buffer, "JPEG", quality=72, optimize=True, comment=MARK
    )
    return buffer.getvalue()
