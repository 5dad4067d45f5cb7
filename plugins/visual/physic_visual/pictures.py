"""The pictures of a result: preview, GLB file and page."""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

# Packages of SciPy import each other, and two threads that import some of them may wait for each
# other.
import scipy.sparse.csgraph
import scipy.sparse.linalg
import scipy.spatial  # noqa: F401

from physic_core.errors import InputError
from physic_core.pictures import GLB_FILE, PREVIEW_FILE, REPORT_FILE
from physic_visual.glb import combined_glb
from physic_visual.preview import preview_png
from physic_visual.report.page import failure_html, report_html

if TYPE_CHECKING:
    from physic_core.types import Reconstruction


def make_pictures(
    result: Reconstruction | InputError, names: Collection[str], title: str
) -> dict[str, bytes]:
    """Return the content of pictures of a result, by their names, as
    :func:`physic_core.pictures.make_pictures` describes.
    """
    if isinstance(result, InputError):
        return {REPORT_FILE: failure_html(title, str(result)).encode()}
    files = dict[str, bytes]()
    # A second thread draws the preview, which takes as long as all else.
    with ThreadPoolExecutor(1, "preview") as second:
        preview = second.submit(preview_png, result) if PREVIEW_FILE in names else None
        if GLB_FILE in names:
            files[GLB_FILE] = combined_glb(result)
        if REPORT_FILE in names:
            files[REPORT_FILE] = report_html(result, title).encode()
        if preview is not None:
            files[PREVIEW_FILE] = preview.result()
    return files
