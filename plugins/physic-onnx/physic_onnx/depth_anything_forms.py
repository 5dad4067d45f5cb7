"""Which of Depth Anything's many files one is, told by its bytes, its ports and its name."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from .one_graph import Speaking

__all__ = ["has_sigmoid", "last_part", "names_version_3", "normalises_itself"]


def has_sigmoid(path: Path) -> bool:
    """Whether an ONNX file has a node of this kind, read off its bytes: a node's type is its field 4, a text."""
    import mmap
    import re

    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return re.search(rb"\x22\x07Sigmoid|\x22\x0eQLinearSigmoid", data) is not None


def normalises_itself(speaking: Speaking) -> bool:
    """Whether a file takes 0 to 255.

    The exports that do call their input 'image', its sides 'H' and 'W', and take one photo.
    """
    port = speaking.ports.inputs["pixel_values"]
    return port.name == "image" and port.shape == (1, 3, "H", "W")


def last_part(weights: str) -> str:
    """Of a path, or the whole name of a set: what folders are called tells nothing."""
    from pathlib import PurePath

    return PurePath(weights).name


def names_version_3(names: str) -> bool:
    """Whether a name is one that files of Depth Anything 3 have."""
    return any(word in names.lower() for word in ("anything-3", "anything_3", "anything-v3", "anything_v3", "da3"))
