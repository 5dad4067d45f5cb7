"""Read the depth of an EXR file: the names of its channels say which one is depth."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError, PackageMissingError
from physic_core.files.atomic import open_regular

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_BYTES = 1_300_000_000
"""Largest map in memory."""

_MAGIC = b"\x76\x2f\x31\x01"
_VALUE_BYTES = 4
_DEPTH = re.compile(r"(?:^|\.)depth(?:\.[zvy])?$", re.IGNORECASE)
"""Such as "depth", or Blender's "ViewLayer.Depth.Z" and "Depth.V"."""


def read_exr(path: Path) -> NDArray[np.generic]:
    """Return the depth channel (H, W) of an EXR file, float16 or float32 as it is stored.

    Raises:
        PackageMissingError: the package OpenEXR is not installed.
        InputError: the file is damaged or too large, or none or several of its channels may be
            depth.
    """
    with open_regular(path) as file:
        if file.read(4) != _MAGIC:
            raise InputError(
                f"cannot read the depth map {path}: it is no EXR file, or it is damaged"
            )
    try:
        import OpenEXR
    except ImportError:
        raise PackageMissingError(
            f"cannot read the depth map {path}: it is EXR, which needs one more package; run `pip "
            f"install OpenEXR`, or "
            "convert it to .npy"
        ) from None
    try:
        heads = OpenEXR.File(str(path), separate_channels=True, header_only=True).parts
        size = sum(_bytes(part.header) for part in heads)
        if size > MAX_BYTES:
            raise InputError(
                f"cannot read {path}: its numbers take {size / 1e9:,.1f} GB, more than "
                f"{MAX_BYTES / 1e9} GB"
            )
        parts = OpenEXR.File(str(path), separate_channels=True).parts
        found = {
            _name(part, name): channel.pixels
            for part in parts
            for name, channel in part.channels.items()
        }
    except InputError:
        raise
    except Exception as error:  # the package raises many classes for damaged files
        raise InputError(f"cannot read the depth map {path}: it is damaged ({error})") from error
    return _depth(found, path)


def _bytes(header: Mapping[str, Any]) -> int:
    low, high = header["dataWindow"]
    width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
    return max(0, width) * max(0, height) * _VALUE_BYTES * len(header["channels"])


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
        f"cannot read the depth map {path}: which of its channels is depth cannot be told: "
        f"{', '.join(channels)}; "
        "write one channel, or name it Z or depth"
    )
