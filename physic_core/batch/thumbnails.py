"""Thumbnails of the photos of a batch: the people over the photo, and the side view."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.files.own import MARK, write_own

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

_HEIGHT = 180  # px of a thumbnail: photo with people, and side view


def thumbnail_path(folder: str) -> str:
    """Return the path of a thumbnail in the output folder for a photo's folder "photos/3f/NAME"."""
    return f"thumbnails/{folder.removeprefix('photos/')}.jpg"


def write_thumbnail(result: Reconstruction, out: Path, folder: str) -> None:
    """Write the people over the photo, and the side view, as one small JPEG of 180 px height.

    Args:
        result: of the photo.
        out: folder of the batch.
        folder: of the photo, relative to ``out``.

    Raises:
        OutputError: it cannot be written.
    """
    import numpy as np
    from PIL import Image

    from physic_core.visual.orthographic_views import build_preview_geometry, side_view
    from physic_core.visual.panels import overlay_panel

    height, width = result.image.shape[:2]
    geometry = build_preview_geometry(result)
    wide = max(60, min(320, round(_HEIGHT * width / height)))
    panels: Sequence[object] = (
        overlay_panel(result, geometry, wide, _HEIGHT),
        side_view(geometry, 220, _HEIGHT).picture,
    )
    buffer = io.BytesIO()
    Image.fromarray(np.concatenate([np.asarray(panel)[:_HEIGHT] for panel in panels], axis=1)).save(
        buffer, "JPEG", quality=72, optimize=True, comment=MARK
    )
    write_own(out / thumbnail_path(folder), buffer.getvalue())
