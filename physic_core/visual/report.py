"""The page of a result, ``report.html``, which physic-viewer or another plugin makes (hook
``physic_pages``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.discovery.hooks import PluginItem
from physic_core.discovery.plugins import Found, call_item, explain_absence, find_items
from physic_core.errors import ConfigError, PackageMissingError, PluginError

if TYPE_CHECKING:
    from physic_core.errors import InputError
    from physic_core.types import Reconstruction

PAGE_MARK = '<meta name="generator" content="PhySIC report">'
"""Element by which a page is recognised, so that a new page may replace it."""

HEAD_BYTES = 500
"""Bytes at the start of a page that the element lies in."""

_DISTRIBUTION = "physic-viewer"


def report_html(reconstruction: Reconstruction | InputError, title: str = "") -> str:
    """Return a page that shows a reconstruction in 3D, with its numbers; it opens from a file,
    without a network.

    The function of the plugin gets the arguments of this one, and returns HTML with
    :data:`PAGE_MARK` in its first 500 bytes.

    Args:
        reconstruction: what to show, or the reason why it cannot be read.
        title: of the page, such as the name of the photo; any text.

    Raises:
        PackageMissingError: no installed plugin makes pages.
        ConfigError: several plugins do.
        PluginError: the plugin cannot be imported, fails, or does not return a page.
    """
    from threadpoolctl import threadpool_limits

    found = require_report()
    with threadpool_limits(limits=1, user_api="blas"):
        page = call_item(found, "page", reconstruction, title or "Reconstruction")
    head = str(page)[:HEAD_BYTES].encode("utf-8", "replace")[:HEAD_BYTES]
    if not isinstance(page, str) or PAGE_MARK.encode() not in head:
        raise PluginError(
            f"{found.title('page')} should be a text with {PAGE_MARK} in its first "
            f"{HEAD_BYTES} bytes, got {str(page)[:60]!r} ({type(page).__name__})"
        )
    return page


def require_report() -> Found[PluginItem]:
    """Return the installed plugin that makes pages, without importing it.

    Raises:
        PackageMissingError: no plugin does.
        ConfigError: several do.
    """
    found = find_items("physic_pages")
    if not found:
        raise PackageMissingError(f"report.html is made by {explain_absence(_DISTRIBUTION)}")
    if len(found) > 1:
        names = " and ".join(one.distribution for one in found)
        raise ConfigError(f"report.html is made by {names}: uninstall one of them")
    return found[0]
