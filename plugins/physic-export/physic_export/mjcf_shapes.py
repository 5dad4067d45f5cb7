"""Meshes and numbers of MJCF files."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

RGBA = "0.77 0.75 0.73 1"
FRICTION = "0.8 0.005 0.0001"
"""Sliding, torsional (m) and rolling (m) friction of floor, scene and people: rubber soles on dry ground."""


def add_mesh(
    asset: ElementTree.Element,
    name: str,
    vertices: NDArray[np.float64],
    faces: NDArray[np.integer[Any]],
    uv: NDArray[np.float64] | None = None,
) -> None:
    """Add a mesh whose numbers are in the file itself, closed unless it has texture coordinates (V, 2), v up."""
    made = ElementTree.SubElement(asset, "mesh", name=name, vertex=numbers(vertices.reshape(-1), 4))
    made.set("face", " ".join(map(str, faces.reshape(-1).tolist())))
    if uv is not None:
        made.set("texcoord", numbers((uv * [1, -1] + [0, 1]).reshape(-1), 5))
        made.set("inertia", "shell")  # an open surface has no volume


def numbers(values: Iterable[float], digits: int = 6) -> str:
    """Return numbers as text."""
    return " ".join(f"{value:.{digits}f}" for value in values)
