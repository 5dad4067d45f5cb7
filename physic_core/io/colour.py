"""Convert colours to sRGB as a file states them: by its ICC profile, or the gamma of a PNG."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageCms

if TYPE_CHECKING:
    from collections.abc import Callable

    Convert = Callable[[Image.Image], Image.Image]

_MAX_PROFILE_BYTES = 8 << 20
_MODES = {"RGB ": "RGB", "CMYK": "CMYK", "GRAY": "L"}
_SAME = 2.0  # grey levels; two profiles of sRGB differ by rounding
_USUAL_GAMMA = 1 / 2.2
_GAMMA_TOLERANCE = 0.02
_LEAST_GAMMA = 0.1
_LARGEST_GAMMA = 3.0


def srgb_conversion(image: Image.Image) -> tuple[str, Convert | None, str]:
    """Return how to convert the colours of an image that was opened but need not be decoded.

    Returns:
        The mode of images that can be converted, "RGB", "CMYK" or "L"; the conversion to RGB, None
        if the colours are sRGB already; and a note if what the file states is lost, else "".
    """
    content = image.info.get("icc_profile")
    if content:
        try:
            mode, convert = _by_profile(content)
        except (ImageCms.PyCMSError, OSError, TypeError, ValueError, KeyError):
            return "", None, "the colour profile cannot be read: colours are taken for sRGB"
        return mode, convert, ""
    gamma = image.info.get("gamma")
    if (
        image.format != "PNG"
        or not gamma
        or "srgb" in image.info
        or abs(gamma - _USUAL_GAMMA) < _GAMMA_TOLERANCE
    ):
        return "", None, ""
    if not _LEAST_GAMMA <= gamma <= _LARGEST_GAMMA:
        return "", None, f"the file states a gamma of {gamma:g}, which is ignored: no photo has it"
    linear = (np.arange(256) / 255) ** (1 / gamma)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    table = (255 * encoded).round().astype(int).tolist() * 3
    few = "the photo is stored almost linearly: its dark parts have few steps in 8 bits"
    return "RGB", lambda band: band.point(table), few if gamma > 2 * _USUAL_GAMMA else ""


def _by_profile(content: bytes) -> tuple[str, Convert | None]:
    if len(content) > _MAX_PROFILE_BYTES:
        raise ValueError(f"a profile of {len(content)} bytes")
    profile = ImageCms.ImageCmsProfile(io.BytesIO(content))
    mode = _MODES[profile.profile.xcolor_space]
    transform = ImageCms.buildTransform(
        profile, ImageCms.createProfile("sRGB"), mode, "RGB", ImageCms.Intent.RELATIVE_COLORIMETRIC
    )
    if mode == "RGB":
        cube = Image.fromarray((np.indices((6, 6, 6)).T.reshape(6, 36, 3) * 51).astype(np.uint8))
        if np.abs(np.asarray(transform.apply(cube), float) - np.asarray(cube)).max() <= _SAME:
            return mode, None
    return mode, transform.apply
