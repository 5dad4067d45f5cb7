"""Mesh of the measured floor for pictures: no larger than the scene, and where the scene has no floor of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.geometry.upright import transform_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Reconstruction
    from physic_core.visual.export.request import ExportFrame
    from physic_core.visual.surface import SceneMesh

_MARGIN_M = 0.5
"""Distance of the floor's edges from people, where the scene is smaller."""
_CELL_M, _MAX_CELLS = 0.1, 300
"""Side of a square of the floor; it grows where the floor would have more squares along a side."""
_NEAR_M = 0.2
"""The scene's surface covers the floor where it is this near to the plane: both would be drawn at one place."""
_CORNERS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [1 / 3] * 3])


def drawn_floor(
    result: Reconstruction, frame: ExportFrame, surface: SceneMesh
) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Return vertices (4 n, 3) and faces (2 n, 3) of rectangles on the floor; None without a floor.

    They lie within the convex outline of scene and people, seen from above, and not where ``surface`` is the floor.
    n is 0 if it is everywhere.
    """
    import cv2

    if result.scene.floor is None:
        return None
    up = int(np.argmax(np.abs(frame.up_vector)))
    plan = [axis for axis in range(3) if axis != up]
    bodies = [person.vertices for person in result.people if np.isfinite(person.vertices).all()]
    feet = transform_points(frame.from_camera, np.concatenate([np.zeros((0, 3)), *bodies]))[:, plan]
    scene = transform_points(frame.from_camera, surface.vertices)
    outline = np.concatenate([scene[:, plan], feet + _MARGIN_M, feet - _MARGIN_M])
    if not len(outline):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    low, size = outline.min(0), np.ptp(outline, axis=0).max()
    cell = max(_CELL_M, float(size) / _MAX_CELLS)
    squares: NDArray[Any] = ((outline - low) / cell).astype(np.int32)
    width, height = squares.max(0) + 1
    inside = np.zeros((height, width), np.uint8)
    inside[squares[:, 1], squares[:, 0]] = 1
    # The outline of the squares: that of all points takes several times as long.
    cv2.fillConvexPoly(inside, cv2.convexHull(cv2.findNonZero(inside)), 1)
    first, second, third = (np.abs(scene[:, up]) < _NEAR_M)[surface.faces.T]
    samples = _CORNERS @ scene[:, plan][surface.faces[first & second & third]]
    covered = np.zeros_like(inside)
    columns, rows = ((samples.reshape(-1, 2) - low) / cell).astype(np.int32).T
    covered[rows, columns] = 1
    covered = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    free = cv2.morphologyEx(inside & ~covered, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    steps = np.diff(np.pad(free, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, start), (_, end) = np.nonzero(steps == 1), np.nonzero(steps == -1)
    vertices = np.zeros((len(row), 4, 3))
    vertices[..., plan[0]] = low[0] + cell * np.stack([start, end, end, start], 1)
    vertices[..., plan[1]] = low[1] + cell * np.stack([row, row, row + 1, row + 1], 1)
    # The axes of the plan are x and y, or x and z: only the first pair is right-handed about up.
    corners = np.array([[0, 1, 2], [0, 2, 3]] if up == 2 else [[2, 1, 0], [3, 2, 0]])
    return vertices.reshape(-1, 3), (4 * np.arange(len(row))[:, None, None] + corners).reshape(-1, 3)
