"""A mesh of the measured floor for pictures, where the scene does not show it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry import transform_points

if TYPE_CHECKING:
    from physic_core.export import ExportFrame
    from physic_core.types import Float64Array, Int64Array, IntArray, Reconstruction
    from physic_visual.scene_mesh import SceneMesh

_MARGIN_M = 0.5
"""Distance of the floor's edges from people, where the scene is smaller."""
_CELL_M = 0.1
_MAX_CELLS = 300
"""Side of a square of the floor; it grows where the floor would have more squares along a side."""
_NEAR_M = 0.2
"""The scene's surface covers the floor where it is this near to the plane: both would be drawn at
one place.
"""
_CORNERS = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [1 / 3] * 3]
)
_HALVES = np.array([[0, 1, 2], [0, 2, 3]])
"""Triangles of a rectangle."""


def floor_rectangles(
    result: Reconstruction, frame: ExportFrame, surface: SceneMesh
) -> tuple[Float64Array, Int64Array] | None:
    """Return vertices (4 n, 3) and faces (2 n, 3) of rectangles on the floor; None without a floor.

    They lie within the convex outline of scene and people, seen from above, and not where
    ``surface`` is the floor. n is 0 if it is everywhere.
    """
    if result.scene.floor is None:
        return None
    up = int(np.argmax(np.abs(frame.up_vector)))
    plan = [0, 3 - up]
    bodies = [person.vertices for person in result.people if person.has_body]
    feet = transform_points(frame.from_camera, np.concatenate([np.zeros((0, 3)), *bodies]))[:, plan]
    scene = transform_points(frame.from_camera, surface.vertices)
    outline = np.concatenate([scene[:, plan], feet + _MARGIN_M, feet - _MARGIN_M])
    if not len(outline):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    low = outline.min(0)
    cell = max(_CELL_M, float(np.ptp(outline, axis=0).max()) / _MAX_CELLS)
    first, second, third = (np.abs(scene[:, up]) < _NEAR_M)[surface.faces.T]
    cell_positions = (scene[:, plan] - low) / cell
    free = _free_squares(
        (outline - low) / cell, _samples(cell_positions, surface.faces[first & second & third])
    )
    spots = _rectangles(free)
    vertices = np.zeros((4 * len(spots), 3))
    vertices[:, plan] = low + cell * spots.reshape(-1, 2)
    # The axes of the plan are x and y, or x and z: only the first pair is right-handed about up.
    corners = _HALVES if up == 2 else _HALVES[:, ::-1]
    return vertices, (4 * np.arange(len(spots))[:, None, None] + corners).reshape(-1, 3)


def _samples(places: Float64Array, faces: Int64Array) -> Float64Array:
    """Return places (M, 2) on faces (F, 3), at most about a square apart: their corners, and more
    of those that are larger than a square.
    """
    corners = places[faces.T]
    large = (corners.max(0) - corners.min(0) > 1).any(1)
    inner = [(_CORNERS @ corners[:, large, axis]).ravel() for axis in (0, 1)]
    used = np.zeros(len(places), bool)
    used[faces] = True
    return np.concatenate([places[used], np.stack(inner, 1)])


def _free_squares(outline: Float64Array, covered: Float64Array) -> IntArray:
    """Return squares (H, W), 1 within the convex outline of places (N, 2) and not at others (M, 2),
    which are columns and rows.
    """
    import cv2

    columns, rows = outline.astype(np.int32).T
    inside = np.zeros((rows.max() + 1, columns.max() + 1), np.uint8)
    inside[rows, columns] = 1
    # The outline of the squares: that of all points takes several times as long.
    cv2.fillConvexPoly(inside, cv2.convexHull(cv2.findNonZero(inside)), 1)
    taken = np.zeros_like(inside)
    columns, rows = covered.astype(np.int32).T
    taken[rows, columns] = 1
    taken = cv2.morphologyEx(taken, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    free = cv2.morphologyEx(inside & ~taken, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(free)


def _rectangles(squares: IntArray) -> Int64Array:
    """Return the corners (n, 4, 2), column and row, of the rows' runs of squares that are 1."""
    steps = np.diff(np.pad(squares, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, start = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)
    columns = np.stack([start, end, end, start], 1)
    return np.stack([columns, np.stack([row, row, row + 1, row + 1], 1)], -1)
