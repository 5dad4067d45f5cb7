"""Write what a run or a batch keeps of a result: everything, the numbers, the people, or nothing; and its thumbnail."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

LEVELS = ("full", "compact", "numbers", "people", "summary")
"""full: JSON, arrays, GLB files, preview. compact: the same, but of the GLB files only the combined one. numbers: JSON,
arrays. people: JSON, arrays of the people. summary: none."""

_HEIGHT = 180  # px of a thumbnail: photo with people, and side view


@dataclass(frozen=True)
class Saving:
    """Which files a batch writes for each photo.

    Attributes:
        level: one of LEVELS.
        preview: write ``preview.png`` at every level.
        glb: write the GLB files at every level but "summary" and "people".
        thumbnails: write a thumbnail for the contact sheet.
        report: write ``report.html`` at every level.
        exact: write the arrays of level "full" as they are, uncompressed, not in their smaller form.
    """

    level: str = "numbers"
    preview: bool = False
    glb: bool = False
    thumbnails: bool = True
    report: bool = False
    exact: bool = False

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise ConfigError(f"what to save is one of {', '.join(LEVELS)} (got '{self.level}')")
        if self.glb and not self.can_be_loaded:
            raise ConfigError(f"--glb needs --save full, compact or numbers (got {self.level})")

    def __str__(self) -> str:
        parts = ("report",) if self.level == "full" else ("preview", "glb", "report")
        return "+".join([self.level, *(name for name in parts if getattr(self, name))])

    @property
    def can_be_loaded(self) -> bool:
        """Whether :func:`physic_core.load_reconstruction` reads what is saved."""
        return self.level in ("full", "compact", "numbers")

    @property
    def main_file(self) -> str:
        """The file of a photo's folder that is written last; "" if there is none."""
        if self.level != "summary":
            return "reconstruction.json"
        return "report.html" if self.report else "preview.png" if self.preview else ""


def save_photo(
    result: Reconstruction,
    folder: Path,
    saving: Saving,
    title: str = "",
    *,
    overwrite: bool = True,
    beside: Mapping[str, bytes] | None = None,
) -> None:
    """Write the files of one result to its folder, each completely or not at all; earlier ones are replaced.

    Args:
        result: of the photo.
        folder: of its files.
        saving: which files.
        title: of the report, such as the name of the photo.
        overwrite: whether to replace another photo's result, or changed files of a result.
        beside: name and content of further files, at every level but "summary".

    Raises:
        OutputError: the disk is full, the folder cannot be written, or data of the user would be lost.
    """
    from physic_core.io.results import save_people, save_reconstruction

    if saving.can_be_loaded:
        pictures = saving.level != "numbers"
        save_reconstruction(
            result,
            folder,
            preview=pictures or saving.preview,
            glb="combined" if saving.level == "compact" and not saving.glb else pictures or saving.glb,
            compact=not saving.exact,
            overwrite=overwrite,
            beside=beside,
        )
    elif saving.level == "people":
        save_people(result, folder, preview=saving.preview, overwrite=overwrite, beside=beside)
    elif saving.preview:
        from physic_core.visual.preview import preview_png

        _write_file(folder / "preview.png", preview_png(result))
    if saving.report:
        from physic_core.io.report_file import add_report, save_report
        from physic_core.io.result_folder import REPORT_FILE

        if saving.level == "summary":
            save_report(result, folder / REPORT_FILE, title)
        else:
            add_report(folder, result, title)


def _write_file(path: Path, content: bytes) -> None:
    from physic_core.files.atomic import atomic_write, check_writable
    from physic_core.files.own import check_own

    check_own(path)
    with atomic_write(check_writable(path.parent)) as temporary:
        temporary(path.name).write_bytes(content)


def thumbnail_path(folder: str) -> str:
    """Return the path of a thumbnail in the output folder for a photo's folder "photos/3f/NAME"."""
    return f"thumbnails/{folder.removeprefix('photos/')}.jpg"


def write_thumbnail(result: Reconstruction, out: Path, folder: str) -> None:
    """Write the thumbnail of a photo.

    Args:
        result: of the photo.
        out: folder of the batch.
        folder: of the photo, relative to ``out``.

    Raises:
        OutputError: it cannot be written.
    """
    _write_file(out / thumbnail_path(folder), render_thumbnail(result))


def render_thumbnail(result: Reconstruction) -> bytes:
    """Render the people over the photo, and the side view, as one small JPEG of 180 px height."""
    import numpy as np
    from PIL import Image

    from physic_core.files.own import MARK
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
    return buffer.getvalue()
