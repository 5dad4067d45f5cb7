"""Pictures of a result: ``preview.png``, ``combined.glb`` and the page ``report.html``, which
metricbody-visual or another plugin makes (hook ``physic_pictures``).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from physic_core.discovery.hooks import PluginItem
from physic_core.discovery.plugins import FoundRecord, absence_message, find_items, import_and_call
from physic_core.errors import ConfigError, PackageMissingError, PluginError

if TYPE_CHECKING:
    from physic_core.errors import InputError
    from physic_core.types import Reconstruction

PREVIEW_FILE = "preview.png"
GLB_FILE = "combined.glb"
REPORT_FILE = "report.html"

PAGE_MARK = '<meta name="generator" content="PhySIC report">'
"""Element by which a page is recognised, so that a new page may replace it."""

HEAD_BYTES = 500
"""Bytes at the start of a page that the element lies in."""

_ROLE = "maker of pictures"
_DISTRIBUTION = "metricbody-visual"


def make_pictures(
    result: Reconstruction | InputError, names: Collection[str], title: str = ""
) -> dict[str, bytes]:
    """Return the content of pictures of a result, by their names.

    The function of the plugin gets the arguments of this one, and returns at least these names. A
    page has :data:`PAGE_MARK` in its first 500 bytes.

    Args:
        result: what to show; of a page alone, also the reason why it cannot be read.
        names: of :data:`PREVIEW_FILE`, :data:`GLB_FILE` and :data:`REPORT_FILE`.
        title: of the page, any text; by default the name of the photo.

    Raises:
        PackageMissingError: no installed plugin makes pictures.
        ConfigError: several plugins do.
        PluginError: the plugin cannot be imported, fails, or does not return these pictures.
    """
    from threadpoolctl import threadpool_limits

    makers = require_pictures()
    # Matrices of three columns: further threads of BLAS would take as much processor time again,
    # waiting.
    with threadpool_limits(limits=1, user_api="blas"):
        title = title or getattr(result, "photo_name", "") or "Reconstruction"
        made = import_and_call(makers, _ROLE, result, names, title)
    pictures = dict[str, bytes]()
    for name in names:
        content = made.get(name) if isinstance(made, Mapping) else made
        if not isinstance(content, bytes):
            raise PluginError(
                f"{makers.title(_ROLE)} should return the bytes of {name}, got "
                f"{str(content)[:60]!r} ({type(content).__name__})"
            )
        if name == REPORT_FILE and PAGE_MARK.encode() not in content[:HEAD_BYTES]:
            raise PluginError(
                f"{makers.title(_ROLE)} should make a page with {PAGE_MARK} in its first "
                f"{HEAD_BYTES} bytes, got {content[:60]!r}"
            )
        pictures[name] = content
    return pictures


def preview_png(reconstruction: Reconstruction) -> bytes:
    """Return the preview of a result as PNG; errors are those of :func:`make_pictures`."""
    return make_pictures(reconstruction, [PREVIEW_FILE])[PREVIEW_FILE]


def report_html(reconstruction: Reconstruction | InputError, title: str = "") -> str:
    """Return a page that shows a reconstruction in 3D, with its numbers; it opens from a file,
    without a network.

    Args:
        reconstruction: what to show, or the reason why it cannot be read.
        title: of the page, any text; by default the name of the photo.

    Errors are those of :func:`make_pictures`.
    """
    return make_pictures(reconstruction, [REPORT_FILE], title)[REPORT_FILE].decode()


def require_pictures() -> FoundRecord[PluginItem]:
    """Return the installed plugin that makes pictures, without importing it.

    Raises:
        PackageMissingError: no plugin does.
        ConfigError: several do.
    """
    makers = find_items("physic_pictures")
    if not makers:
        raise PackageMissingError(
            f"pictures and pages of a result are made by {absence_message(_DISTRIBUTION)}; "
            '--save numbers (save="numbers" in Python) needs none'
        )
    if len(makers) > 1:
        names = " and ".join(one.distribution for one in makers)
        raise ConfigError(f"pictures of a result are made by {names}: uninstall one of them")
    return makers[0]
