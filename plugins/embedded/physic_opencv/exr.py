"""Read the depth of an EXR file: the names of its channels say which one is depth."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError, PackageMissingError
from physic_core.files import open_regular

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_BYTES = 1_300_000_000
"""Largest map in memory."""

_MAGIC = b"\x76\x2f\x31\x01"
_VALUE_BYTES = 4
_DEPTH = re.compile(r"(?:^|\.)depth(?:\.[zvy])?$", re.IGNORECASE)
"""Such as "depth", or Blender's "ViewLayer.Depth.Z" and "Depth.V"."""


def read_exr(path: Path) -> NDArray[np.generic]:
    """Return the depth channel (H, W) of an EXR file, float16 or float32 as it is stored, on the
    display window, NaN where the data window ends before it.

    Raises:
        PackageMissingError: the package OpenEXR is not installed.
        InputError: the file is damaged or too large, none or several of its channels may be depth,
            or none of its pixels is displayed.
    """
    with open_regular(path) as file:
        if file.read(4) != _MAGIC:
            raise InputError(
                f"cannot read the depth map {path}: it is not an EXR file, or it is damaged"
            )
    try:
        import OpenEXR
    except ImportError:
        raise PackageMissingError(
            f"cannot read the depth map {path}: it is EXR, which needs one more package; run `pip "
            "install OpenEXR`, or convert it to .npy"
        ) from None
    try:
        heads = OpenEXR.File(str(path), separate_channels=True, header_only=True).parts
        size = sum(_byte_count(part.header) for part in heads)
        check_size(path, size)
        parts = OpenEXR.File(str(path), separate_channels=True).parts
        channels = {
            _name(part, name): _on_display_window(channel.pixels, part.header, path)
            for part in parts
            for name, channel in part.channels.items()
        }
    except InputError:
        raise
    except Exception as error:  # the package raises many classes for damaged files
        raise InputError(f"cannot read the depth map {path}: it is damaged ({error})") from error
    return _depth(channels, path)


def check_size(path: Path, size: int) -> None:
    """Raise InputError if the numbers of a file take more than :data:`MAX_BYTES`."""
    if size > MAX_BYTES:
        raise InputError(
            f"cannot read {path}: its numbers take {size / 1e9:,.1f} GB, more than "
            f"{MAX_BYTES / 1e9} GB"
        )


def _byte_count(header: Mapping[str, Any]) -> int:
    """Return the bytes of all channels on the larger of the two windows."""
    sizes = [_header_window(header, name) for name in ("dataWindow", "displayWindow")]
    pixels = max(max(0, x1 - x0) * max(0, y1 - y0) for x0, y0, x1, y1 in sizes)
    return pixels * _VALUE_BYTES * len(header["channels"])


def _header_window(header: Mapping[str, Any], name: str) -> tuple[int, int, int, int]:
    """Return a window's x0, y0, x1 and y1, of which the last two are outside."""
    (x0, y0), (x1, y1) = header[name]
    return int(x0), int(y0), int(x1) + 1, int(y1) + 1


def _on_display_window(
    pixels: NDArray[np.generic], header: Mapping[str, Any], path: Path
) -> NDArray[np.generic]:
    """Return a channel on the display window. Channels of whole numbers stay as they are."""
    stored = _header_window(header, "dataWindow")
    display_window = _header_window(header, "displayWindow")
    if stored == display_window or not np.issubdtype(pixels.dtype, np.floating):
        return pixels
    x0, y0, x1, y1 = (
        pick(a, b) for pick, a, b in zip((max, max, min, min), stored, display_window, strict=True)
    )
    if x0 >= x1 or y0 >= y1:
        raise InputError(
            f"cannot read the depth map {path}: its data window {stored} lies outside of its "
            f"display window {display_window}; write the file anew with both of the photo's size"
        )
    placed = np.full(
        (display_window[3] - display_window[1], display_window[2] - display_window[0]),
        np.nan,
        pixels.dtype,
    )
    placed[
        y0 - display_window[1] : y1 - display_window[1],
        x0 - display_window[0] : x1 - display_window[0],
    ] = pixels[y0 - stored[1] : y1 - stored[1], x0 - stored[0] : x1 - stored[0]]
    return placed


def _name(part: Any, channel: str) -> str:
    """Return the name of a channel with that of its part, which Blender 5 writes for each pass."""
    name = part.name()
    return channel if not name or channel.startswith(name) else f"{name}.{channel}"


def _depth(channels: Mapping[str, NDArray[np.generic]], path: Path) -> NDArray[np.generic]:
    """Return the channel that is depth.

    It is the only one, the one that is named depth, Z without X and Y, or any of three equal
    colours.
    """
    if len(channels) == 1:
        return next(iter(channels.values()))
    named = [name for name in channels if _DEPTH.search(name)]
    if len(named) == 1:
        return channels[named[0]]
    if "Z" in channels and not {"X", "Y"} & channels.keys():
        return channels["Z"]
    colours = [channels[name] for name in "RGB" if name in channels]
    if (
        not named
        and len(colours) == 3
        and all(np.array_equal(colours[0], other) for other in colours[1:])
    ):
        return colours[0]
    raise InputError(
        f"cannot read the depth map {path}: it is unclear which channel is depth: "
        f"{', '.join(channels)}; write one channel, or name it Z or depth"
    )
