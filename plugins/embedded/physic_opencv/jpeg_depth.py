"""Read the depth map in the XMP data of a phone's JPEG: GDepth of Google's Depth Map Metadata 1.0.

It has 8 bits between the stated ``Near`` and ``Far``, in the format RangeInverse or RangeLinear.
Where it does not state metres as its unit, its order is right, and its size is not promised.
"""

from __future__ import annotations

import base64
import binascii
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_core.files import ImageSource, decode, open_image

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import FloatArray

_EXTENSION = b"http://ns.adobe.com/xmp/extension/\0"
_ENTRY = re.compile(rb"""GDepth:(\w+)(?:\s*=\s*["']|>)\s*([^"'<]*)""")


def read_jpeg_depth(path: Path) -> tuple[FloatArray, bool]:
    """Return the depth (H, W) in metres, inf at infinity, and whether it is relative.

    Raises:
        InputError: the file cannot be read, has no depth map, or one that does not state its range.
    """
    source = ImageSource(str(path), path=path, role="depth map")
    with open_image(source) as (image, _):
        xmp = _read_xmp(image)
    entries = {name.decode(): value.decode("latin-1") for name, value in _ENTRY.findall(xmp)}
    if "Data" not in entries:
        kind = b"photos/dd/1.0" in xmp
        raise InputError(
            f"the photo {path} has its depth as Dynamic Depth, which is not read: save the photo "
            "with depth as HEIC, or extract the map (exiftool -b) and convert it to meters in .npy"
            if kind
            else f"the photo {path} has no depth map in its XMP data: give meters in .npy or .exr, "
            "or a PNG of 16 bits in millimeters"
        )
    try:
        near, far = float(entries["Near"]), float(entries["Far"])
        content = base64.b64decode(entries["Data"], validate=False)
    except (KeyError, ValueError, binascii.Error):
        near = far = 0.0
        content = b""
    form = entries.get("Format", "")
    if not 0 < near < far < np.inf or form not in ("RangeInverse", "RangeLinear") or not content:
        raise InputError(
            f"the depth map in {path} does not state its range (format {form or 'none'}, near "
            f"{entries.get('Near', 'none')}, far {entries.get('Far', 'none')}), so its meters are "
            "not known; convert it to .npy"
        )
    inner = ImageSource(f"in {path}", content, role="depth map")
    with open_image(inner) as (picture, _):
        decode(picture, inner)
        share = np.asarray(picture.convert("L"), np.float64) / 255
    depth = (
        near + share * (far - near)
        if form == "RangeLinear"
        else far * near / (far - share * (far - near))
    )
    return depth, entries.get("Units") != "m"


def _read_xmp(image: Any) -> bytes:
    """Return the XMP data of a JPEG of Pillow, with what did not fit into its first segment."""
    main = image.info.get("xmp") or b""
    parts = [
        (int.from_bytes(data[len(_EXTENSION) + 36 : len(_EXTENSION) + 40]), data)
        for name, data in getattr(image, "applist", ())
        if name == "APP1" and data.startswith(_EXTENSION)
    ]
    extended = b"".join(data[len(_EXTENSION) + 40 :] for _, data in sorted(parts))
    return main + b"\n" + extended
