"""Meshes and numbers of MJCF files."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

RGBA = "0.77 0.75 0.73 1"
FRICTION = "0.8 0.005 0.0001"
"""Sliding, torsional (m) and rolling (m) friction of floor, scene and people: rubber soles on dry ground."""


def convex_hull(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices and faces of the convex hull of points (n, 3)."""
    import trimesh

    hull = trimesh.convex.convex_hull(points)
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def add_mesh(
    asset: ElementTree.Element, name: str, vertices: NDArray[np.float64], faces: NDArray[np.integer[Any]]
) -> None:
    """Add a mesh whose numbers are in the file itself."""
    indices = " ".join(map(str, faces.reshape(-1).tolist()))
    ElementTree.SubElement(asset, "mesh", name=name, vertex=numbers(vertices.reshape(-1), 4), face=indices)


def numbers(values: Iterable[float], digits: int = 6) -> str:
    """Return numbers as text."""
    return " ".join(f"{value:.{digits}f}" for value in values)
