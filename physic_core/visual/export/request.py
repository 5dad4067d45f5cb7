"""What an exporter gets: the result, the frame that it writes in, and a mesh of the measured floor
for pictures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_core.geometry.upright import gltf_from_camera, transform_points

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from physic_core.types import Person, Plane, Reconstruction
    from physic_core.visual.surface import SceneMesh

_Z_UP_FROM_Y_UP = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class ExportFrame:
    """Frame of an exported file, in metres.

    Attributes:
        up: "y", "z" or "camera".
        from_camera: (4, 4) rigid transform from the camera frame (x right, y down, z forward).
        axes: description of the axes and the origin.
        notes: sentences for the user.
    """

    up: str
    from_camera: NDArray[np.float64]
    axes: str
    notes: tuple[str, ...] = ()

    @property
    def up_vector(self) -> NDArray[np.float64]:
        """Unit vector (3,) that points up in this frame; of a camera frame, the camera's up."""
        return np.array(
            {"y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0], "camera": [0.0, -1.0, 0.0]}[self.up]
        )


@dataclass(frozen=True)
class ExportRequest:
    """One export.

    Attributes:
        result: the reconstruction.
        person: indices of the people to write; each has a finite body.
        frame: of the file.
        stem: file name without suffix.
        suffix: of the file, with its dot.
        scene: whether to write the scene too.
        body_file: SMPL-X file of the user, or None.
        options: name -> value of the ``options`` of the record; their defaults where the user gave
            none.
    """

    result: Reconstruction
    person: tuple[int, ...]
    frame: ExportFrame
    stem: str
    suffix: str
    scene: bool = True
    body_file: Path | None = None
    options: Mapping[str, str | bool] = field(default_factory=dict)

    def chosen(self) -> list[tuple[int, Person]]:
        """Return index and person of the people to write."""
        return [(index, self.result.people[index]) for index in self.person]

    def file_of(self, person: int) -> str:
        """Return the name of the file of one person: the stem, with the person's number if there
        are several.
        """
        return (
            f"{self.stem}{self.suffix}"
            if len(self.person) == 1
            else f"{self.stem}_{person}{self.suffix}"
        )


def export_frame(level: Plane | None, up: str) -> ExportFrame:
    """Return the frame with an up axis.

    "y" and "z" have the origin on the floor below the camera, and the camera looks along -z or +y.
    "camera" is the frame of the result. Without a floor, the origin is the camera. If nothing
    tells up, y is the camera's up axis.

    Args:
        level: the floor, or the level plane through the camera; None if nothing tells up.
        up: "y", "z" or "camera".

    Raises:
        InputError: z up if nothing tells up.
    """
    if up == "camera":
        return ExportFrame(up, np.eye(4), "x right, y down, z forward, origin at the camera")
    matrix = gltf_from_camera(level)
    origin = "origin on the floor below the camera"
    notes: tuple[str, ...] = ()
    if level is None or not level.offset:
        origin = "origin at the camera"
        axis = "the camera's up axis" if level is None else "up"
        notes = (f"the result has no floor: {up} is {axis}, and the origin is the camera",)
    if up == "z":
        if level is None:
            raise InputError(
                "z up needs the direction of gravity, and this result has neither a floor nor "
                "edges that tell it: "
                "use a format with --up y (y is then the camera's up axis) or --up camera"
            )
        axes = f"x right, y forward, z up, {origin}"
        return ExportFrame(up, _Z_UP_FROM_Y_UP @ matrix, axes, notes)
    of_camera = " (of the camera)" if level is None else ""
    return ExportFrame(up, matrix, f"x right, y up{of_camera}, z backward, {origin}", notes)


def camera_pose(frame: ExportFrame) -> NDArray[np.float64]:
    """Return the pose (4, 4) of a camera that looks along its -z with y up, as in glTF, USD and
    MuJoCo.
    """
    return frame.from_camera @ np.diag([1.0, -1.0, -1.0, 1.0])


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


def drawn_floor(
    result: Reconstruction, frame: ExportFrame, surface: SceneMesh
) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
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
    samples = _CORNERS @ scene[:, plan][surface.faces[first & second & third]]
    free = _free_squares((outline - low) / cell, (samples.reshape(-1, 2) - low) / cell)
    spots = _rectangles(free)
    vertices = np.zeros((4 * len(spots), 3))
    vertices[:, plan] = low + cell * spots.reshape(-1, 2)
    # The axes of the plan are x and y, or x and z: only the first pair is right-handed about up.
    corners = _HALVES if up == 2 else _HALVES[:, ::-1]
    return vertices, (4 * np.arange(len(spots))[:, None, None] + corners).reshape(-1, 3)


def _free_squares(
    outline: NDArray[np.float64], covered: NDArray[np.float64]
) -> NDArray[np.integer[Any]]:
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


def _rectangles(squares: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Return the corners (n, 4, 2), column and row, of the rows' runs of squares that are 1."""
    steps = np.diff(np.pad(squares, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, start = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)
    columns = np.stack([start, end, end, start], 1)
    return np.stack([columns, np.stack([row, row, row + 1, row + 1], 1)], -1)
