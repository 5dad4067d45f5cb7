"""Assemble ``report.html`` from its parts: markup, style, scripts and data in one file without any
address.

The content security policy of the page names the digests of its own scripts. A browser runs no
other script, whatever text a photo's name or a warning contains, and loads nothing from anywhere.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from physic_core.pictures import PAGE_MARK
from physic_visual.report.contents import page_contents

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

_SCRIPTS = (
    "elements.js",
    "decode.js",
    "stage.js",
    "legend.js",
    "photo.js",
    "panel.js",
    "measure.js",
    "save.js",
    "main.js",
)
_TOKEN = re.compile(r"@([A-Z]+)@")


def report_html(reconstruction: Reconstruction, title: str = "") -> str:
    """Return a page that shows a reconstruction in 3D, with its numbers; it opens from a file,
    without a network.

    The page of a photo has about 3 MB, and at most 7 MB. With ``#view`` after its address, it shows
    the 3D view alone.

    Args:
        reconstruction: what to show.
        title: of the page, such as the name of the photo; any text.
    """
    contents = page_contents(reconstruction, title or "Reconstruction")
    # "<" cannot end the script element.
    data = json.dumps(contents, ensure_ascii=True, allow_nan=False, separators=(",", ":")).replace(
        "<", "\\u003c"
    )
    script = "\n".join(_read_part(name) for name in _SCRIPTS)
    return _fill_template(
        _read_part("report.html"),
        {
            "GENERATOR": PAGE_MARK,
            "POLICY": _content_security_policy(_read_part("vendor/three.js"), script),
            "TITLE": _escaped(title or "Reconstruction"),
            "STYLE": _read_part("report.css"),
            "THREE": _read_part("vendor/three.js"),
            "DATA": data,
            "SCRIPT": script,
        },
    )


def failure_html(title: str, message: str) -> str:
    """Return a page that says why a result cannot be shown.

    Args:
        title: of the page, such as the name of the photo or folder; any text.
        message: what is wrong, and what to do; any text.
    """
    fields = {
        "TITLE": _escaped(title),
        "MESSAGE": _escaped(message),
        "STYLE": _read_part("report.css"),
    }
    return _fill_template(
        _read_part("failure.html"),
        {"GENERATOR": PAGE_MARK, "POLICY": _content_security_policy(), **fields},
    )


def _escaped(text: str) -> str:
    """Escape text for the page; lone surrogates of file names that are not UTF-8 are shown as
    escapes.
    """
    return html.escape(text.encode("utf-8", "backslashreplace").decode("utf-8"))


@cache
def _read_part(name: str) -> str:
    return (files("physic_visual.report") / "page" / name).read_text(encoding="utf-8")


def _fill_template(template: str, fields: dict[str, str]) -> str:
    """Replace each @NAME@ of a template in one pass, so that text of a field never passes for a
    token.
    """
    return _TOKEN.sub(lambda match: fields[match[1]], template)


def _content_security_policy(*scripts: str) -> str:
    """Return a content security policy that allows these scripts, the page's own style, and
    pictures in the page.
    """
    # The element of a script begins and ends with a line break, which is part of its text.
    digests = (
        base64.b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
        for script in scripts
    )
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'"
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"
    )
