"""Convert colours to sRGB as a file states them: by its code points of H.273 (cICP of a PNG, nclx
of AVIF and HEIF), its ICC profile, or the gamma of a PNG.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageCms

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import BinaryIO

    from physic_core.types import FloatArray

    Convert = Callable[[Image.Image], Image.Image]

_MAX_PROFILE_BYTES = 8 << 20
_MODES = {"RGB ": "RGB", "CMYK": "CMYK", "GRAY": "L"}
_SAME = 2.0  # grey levels; two profiles of sRGB differ by rounding
_USUAL_GAMMA = 1 / 2.2
_GAMMA_TOLERANCE = 0.02
_LEAST_GAMMA = 0.1
_LARGEST_GAMMA = 3.0


_HEADER_BYTES = 1 << 20  # of a file, in which the colours are stated before the pixels
_SDR_WHITE = 203.0  # cd/m2 of what is white without being a light (ITU-R BT.2408)
_HLG_PEAK = 1000.0  # cd/m2 of the display for which HLG is shown (BT.2100)
_TO_SRGB = {  # from linear light of the code points of primaries
    9: ((1.6605, -0.5876, -0.0728), (-0.1246, 1.1329, -0.0083), (-0.0182, -0.1006, 1.1187)),
    12: ((1.2249, -0.2247, 0.0), (-0.0420, 1.0419, 0.0), (-0.0197, -0.0786, 1.0979)),
}
_LIKE_SRGB = (1, 2, 5, 6, 7)  # primaries that differ little from sRGB's, or are not stated
_PQ = 16
_HLG = 18
_LINEAR = 8
_POWERS = {4: 2.2, 5: 2.8}
_CURVES_LIKE_SRGB = (1, 2, 6, 7, 13, 14, 15)


def code_points(file: BinaryIO) -> tuple[int, int] | None:
    """Return the code points of primaries and transfer function that a PNG, AVIF or HEIF states;
    None if it states none.
    """
    header = file.read(_HEADER_BYTES)
    if header.startswith(b"\x89PNG"):
        place = 8
        while place + 12 <= len(header) and (kind := header[place + 4 : place + 8]) != b"IDAT":
            if kind == b"cICP":
                return header[place + 8], header[place + 9]
            place += 12 + int.from_bytes(header[place : place + 4])
        return None
    at = header.find(b"colrnclx") if header[4:8] == b"ftyp" else -1
    if at < 0 or at + 12 > len(header):
        return None
    return int.from_bytes(header[at + 8 : at + 10]), int.from_bytes(header[at + 10 : at + 12])


def _by_code_points(primaries: int, transfer: int) -> tuple[Convert | None, str]:
    """Return the conversion of RGB to sRGB, None if the colours are sRGB's, and a note if what the
    file states is lost.
    """
    is_known = transfer in (_PQ, _HLG, _LINEAR, *_POWERS, *_CURVES_LIKE_SRGB)
    if not is_known or primaries not in (*_LIKE_SRGB, *_TO_SRGB):
        return None, (
            f"the colors have primaries {primaries} and transfer function {transfer} of H.273, "
            "which PhySIC reads as sRGB: if the photo looks wrong, save it as sRGB"
        )
    if transfer in _CURVES_LIKE_SRGB and primaries in _LIKE_SRGB:
        return None, ""
    values = np.arange(256) / 255
    linear = _linear_light(values, transfer).astype(np.float32)
    matrix = np.asarray(_TO_SRGB.get(primaries, np.eye(3)), np.float32)
    encoded = (255 * _srgb_curve(np.arange(1 << 14) / ((1 << 14) - 1))).round().astype(np.uint8)

    def convert(band: Image.Image) -> Image.Image:
        light = linear[np.asarray(band)]
        if transfer == _HLG:  # the display makes the light of the scene brighter where it is bright
            of_scene = light @ np.array([0.2627, 0.6780, 0.0593], np.float32)
            light = light * (_HLG_PEAK / _SDR_WHITE * of_scene**0.2)[..., None]
        light = (light @ matrix.T).clip(0, 1)
        return Image.fromarray(encoded[(light * (len(encoded) - 1)).astype(np.int32)])

    note = "high dynamic range was converted to sRGB: what is brighter than white is lost"
    return convert, note if transfer in (_PQ, _HLG) else ""


def _linear_light(values: FloatArray, transfer: int) -> FloatArray:
    """Return the light of encoded values, relative to white; for HLG that of the scene."""
    if transfer == _PQ:  # SMPTE ST 2084
        root = values ** (1 / 78.84375)
        light = (root - 0.8359375).clip(0) / (18.8515625 - 18.6875 * root)
        return np.asarray(light ** (1 / 0.1593017578125) * (10_000 / _SDR_WHITE))
    if transfer == _HLG:  # BT.2100
        upper = (np.exp((values - 0.55991073) / 0.17883277) + 0.28466892) / 12
        return np.where(values <= 0.5, values**2 / 3, upper)
    if transfer in _POWERS:
        return np.asarray(values ** _POWERS[transfer])
    if transfer == _LINEAR:
        return values
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _srgb_curve(linear: FloatArray) -> FloatArray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def srgb_conversion(
    image: Image.Image, stated: tuple[int, int] | None = None
) -> tuple[str, Convert | None, str]:
    """Return how to convert the colours of an image that was opened but need not be decoded.

    Args:
        image: of Pillow.
        stated: code points of its file, which a profile does not replace.

    Returns:
        The mode of images that can be converted, "RGB", "CMYK" or "L"; the conversion to RGB, None
        if the colours are sRGB already; and a note if what the file states is lost, else "".
    """
    if stated is not None and stated[1] != 2:  # 2: not stated
        convert, note = _by_code_points(*stated)
        return "RGB", convert, note
    content = image.info.get("icc_profile")
    if content:
        try:
            mode, convert = _by_profile(content)
        except (ImageCms.PyCMSError, OSError, TypeError, ValueError, KeyError):
            return "", None, "the color profile cannot be read: PhySIC assumes sRGB"
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
    table = (255 * _srgb_curve(linear)).round().astype(int).tolist() * 3
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
