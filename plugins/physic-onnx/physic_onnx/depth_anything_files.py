"""Recognise the many ONNX files of Depth Anything by their bytes, ports and names."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from .one_graph import LoadedGraph


def has_sigmoid(path: Path) -> bool:
    """Return whether an ONNX file contains a sigmoid node, by searching its bytes for the node type."""
    import mmap
    import re

    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return re.search(rb"\x22\x07Sigmoid|\x22\x0eQLinearSigmoid", data) is not None


def takes_raw_pixels(loaded: LoadedGraph) -> bool:
    """Return whether a file takes pixels from 0 to 255 and normalises them itself.

    Exports that do so name their input 'image' and its sides 'H' and 'W', and take one photo.
    """
    port = loaded.ports.inputs["pixel_values"]
    return port.name == "image" and port.shape == (1, 3, "H", "W")


def base_name(weights: str) -> str:
    """Return the last component of a path, or the full name of a weight set."""
    from pathlib import PurePath

    return PurePath(weights).name


def is_version_3_name(names: str) -> bool:
    """Return whether a file name belongs to Depth Anything 3."""
    return any(word in names.lower() for word in ("anything-3", "anything_3", "anything-v3", "anything_v3", "da3"))
