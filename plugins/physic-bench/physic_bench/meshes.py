"""Meshes of bodies and scenes from .ply and .obj files."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from physic_bench.contract import Surface
from physic_bench.damage import DamagedFrameError, damaged_file_error

MAX_BODY_M = 3.0


def read_mesh(path: Path) -> Surface:
    """Read the vertices, in their order, and triangles of a file.

    Raises:
        DamagedFrameError: the file is missing, cut off or no mesh.
    """
    mesh = _load(path)
    faces = getattr(mesh, "faces", None)
    return Surface(
        np.asarray(mesh.vertices, np.float64), np.zeros((0, 3), np.int64) if faces is None else np.asarray(faces)
    )


def read_vertex_colours(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return the colours (V, 4) uint8 RGBA of a mesh file.

    Raises:
        DamagedFrameError: the file is missing, cut off, or has no colours.
    """
    mesh = _load(path)
    if mesh.visual.kind != "vertex":
        raise DamagedFrameError(f"{path} has no colours of vertices")
    return np.asarray(mesh.visual.vertex_colors, np.uint8)


@lru_cache(maxsize=4)
def read_scene_mesh(path: Path) -> Surface:
    """Read the mesh of a scene once per process."""
    return read_mesh(path)


def require_metres(vertices: np.ndarray[tuple[int, ...], np.dtype[np.float64]], path: Path) -> None:
    """Raise DamagedFrameError for a body that is not of a person's size."""
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices).all(-1)).sum())
        raise DamagedFrameError(f"{bad} of the {len(vertices)} vertices of the body in {path} are not finite")
    size = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if not 0.2 < size < MAX_BODY_M:
        unit = " (millimetres?)" if 200 < size < 1000 * MAX_BODY_M else ""
        raise DamagedFrameError(f"the body in {path} measures {size:.3g} m{unit}: lengths must be metres")


def _load(path: Path) -> Any:
    import trimesh

    if not path.is_file():
        raise DamagedFrameError(f"there is no file {path}")
    try:
        mesh = trimesh.load(path, process=False, maintain_order=True)
    except Exception as error:  # of trimesh's readers, which have many
        if isinstance(error, PermissionError):
            raise damaged_file_error(path, error) from error
        raise DamagedFrameError(
            f"{path} cannot be read as a mesh: it is damaged or truncated, copy it again"
        ) from error
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_mesh()
    if not len(getattr(mesh, "vertices", ())):
        raise DamagedFrameError(f"{path} cannot be read as a mesh: it has no vertices")
    return mesh
