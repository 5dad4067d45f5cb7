from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

SMALL = np.random.default_rng(0).integers(0, 255, (9, 12, 3), np.uint8)
PICTURE = Image.fromarray(SMALL).resize((96, 72))


@pytest.fixture(scope="session")
def stored():
    """A function that returns the bytes of a file of a format, with XMP and EXIF tags."""

    def store(kind, picture=PICTURE, *, xmp=b"", exif=None, **options):
        if kind == "TIFF":
            options["tiffinfo"] = dict(exif or {}) | ({700: xmp} if xmp else {})
        elif kind == "PNG" and xmp:
            options["pnginfo"] = PngImagePlugin.PngInfo()
            options["pnginfo"].add_itxt("XML:com.adobe.xmp", xmp.decode())
        elif xmp:
            options["xmp"] = xmp
        if exif and kind != "TIFF":
            tags = Image.Exif()
            tags.update({tag: value for tag, value in exif.items() if tag < 0x9000})
            tags.get_ifd(0x8769).update(
                {tag: value for tag, value in exif.items() if tag >= 0x9000}
            )
            options["exif"] = tags
        file = io.BytesIO()
        picture.save(file, kind, **options)
        return file.getvalue()

    return store
