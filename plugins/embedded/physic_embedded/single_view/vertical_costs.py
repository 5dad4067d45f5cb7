"""Walls and standing bodies as cues for the disparity at infinity.

A plane of the scene is a plane over the pixels of a disparity map, ``disparity = a x + b y + c``
with the ray (x, y, 1), and its normal is proportional to (a, b, c - infinity). So two planes that
are known to be perpendicular, such as a wall and the floor, determine the disparity at infinity. A
person who stands defines a vertical plane through the camera: gravity lies in it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import legs_in_line
from physic_core.types import SURE_CONFIDENCE
from physic_embedded.body_fit.limb_keypoints import limb_keypoints, sided_indices

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Keypoints


NO_PLANES = np.zeros((0, 3))

# Of a body that stands, in the picture, where limbs that point towards the camera look straight.
_MAX_BEND_DEG = 25.0
_AXIS_SIGMA_DEG = 4.0  # of a standing body from the vertical
_SIDE = 160  # px, long side of the grid on which walls are looked at
_FEWEST = 100
_MOST_PLANES = 1500  # that are looked at
_LARGEST_SLOPES = 90  # percentile of the slopes of wall pixels; the steepest are depth edges
_WALL_SIGMA_DEG = 5.0  # error of a wall's normal
_MAX_WALL_DEG = 30.0  # a larger deviation is not a wall
_WALLS = 6.0  # number of independent observations that the pixels of all walls are worth
_FRAME_SIGMA = np.radians(8.0)  # error of a surface's normal about a direction of its room
_CLUTTER = 0.4  # share of surfaces in any direction
_SURFACES = 12.0  # number of independent observations that the pixels of all surfaces are worth


def local_disparity_planes(
    disparity: FloatArray, surfaces: BoolArray, focal_px: float
) -> FloatArray:
    """Return the local planes (M, 3) a, b, c of a disparity map at the pixels of surfaces.

    Args:
        disparity: (H, W), larger is nearer.
        surfaces: (H, W) bool.
        focal_px: focal length at the resolution of ``disparity``.

    Returns:
        (M, 3) float64, M = 0 where too few pixels are left.
    """
    import cv2

    height, width = disparity.shape
    step = max(1, max(height, width) // _SIDE)
    window = np.ones((2 * step + 1, 2 * step + 1), np.uint8)
    smooth = cv2.GaussianBlur(np.asarray(disparity, np.float32), (0, 0), step)[
        ::step, ::step
    ].astype(np.float64)
    inside = cv2.erode(surfaces.astype(np.uint8), window)[::step, ::step] > 0
    inside[:2] = inside[-2:] = False
    inside[:, :2] = inside[:, -2:] = False
    if inside.sum() < _FEWEST:
        return NO_PLANES
    down, right = np.gradient(smooth)
    slope = np.hypot(down, right)
    inside &= slope <= np.percentile(slope[inside], _LARGEST_SLOPES)
    rows, columns = np.mgrid[0:height:step, 0:width:step]
    a = right / step * focal_px
    b = down / step * focal_px
    c = smooth - (a * (columns - (width - 1) / 2) + b * (rows - (height - 1) / 2)) / focal_px
    planes = np.stack([a, b, c], -1)[inside]
    return np.asarray(planes[:: max(1, -(-len(planes) // _MOST_PLANES))])


def walls_cost(planes: FloatArray, infinity: FloatArray, down: FloatArray) -> FloatArray:
    """Return how badly walls stand upright, -2 log likelihood up to a constant, (C,).

    The spread of the walls about the vertical is estimated too, so that curved or wrongly labelled
    walls count less.

    Args:
        planes: (M, 3) of :func:`local_disparity_planes`.
        infinity: (C,) candidates of the disparity at infinity.
        down: (C, 3) unit normals of the floor for each candidate.
    """
    rest, length = _normals(planes, infinity)
    along = down[:, :2] @ planes[:, :2].T + down[:, 2:] * rest
    tilt = np.degrees(np.arcsin(np.clip(np.abs(along) / length, 0, 1)))
    return np.asarray(
        _WALLS * np.log(np.minimum(tilt, _MAX_WALL_DEG) ** 2 + _WALL_SIGMA_DEG**2).mean(1)
    )


def frame_cost(planes: FloatArray, infinity: FloatArray, axes: FloatArray) -> FloatArray:
    """Return how badly surfaces agree with the directions of a room, -2 log likelihood up to a
    constant, (C,).

    A normal lies about one of the directions, or anywhere.

    Args:
        planes: (M, 3) of :func:`local_disparity_planes`.
        infinity: (C,) candidates of the disparity at infinity.
        axes: (3, 3) unit directions in rows.
    """
    rest, length = _normals(planes, infinity)
    along = planes[:, :2] @ axes[:, :2].T + rest[..., None] * axes[:, 2]
    near = np.exp((np.abs(along) / length[..., None] - 1) / _FRAME_SIGMA**2).sum(-1)
    odds = _CLUTTER + (1 - _CLUTTER) / 3 / _FRAME_SIGMA**2 * near
    return np.asarray(-2 * _SURFACES * np.log(odds).mean(1))


def _normals(planes: FloatArray, infinity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the third components (C, M) and the lengths (C, M) of the normals of planes (M, 3)."""
    rest = planes[:, 2] - infinity[:, None]
    return rest, np.sqrt((planes[:, :2] ** 2).sum(1) + rest**2) + 1e-12


def body_planes(
    keypoints: Keypoints | None, center: tuple[float, float], focal_px: float
) -> FloatArray:
    """Return the unit normals (N, 3) of the planes through the camera and the bodies of people who
    stand straight.

    A body counts if both legs are straight, and in line with the trunk.

    Args:
        keypoints: of the photo, or None.
        center: principal point x, y, px.
        focal_px: focal length, px.
    """
    if keypoints is None or not len(keypoints.points):
        return NO_PLANES
    keypoints = limb_keypoints(keypoints)
    rows = sided_indices(keypoints.joint_set, "shoulder", "hip", "knee", "ankle")
    visible = keypoints.confidence[:, rows].min(1) >= SURE_CONFIDENCE
    shoulders, hips, knees, ankles = np.split(keypoints.points[:, rows], 4, 1)
    shoulder = shoulders.mean(1)
    ankle = ankles.mean(1)
    straight = visible & legs_in_line(
        hips, knees, ankles, neck=shoulder, max_deg=_MAX_BEND_DEG
    ).all(1)
    ones = np.ones((int(straight.sum()), 1))
    high, low = (
        np.concatenate([(p[straight] - center) / focal_px, ones], 1) for p in (shoulder, ankle)
    )
    normals = np.cross(high, low)
    return np.asarray(normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12))


def axes_cost(normals: FloatArray, down: FloatArray) -> FloatArray:
    """Return how far gravity is from the bodies of standing people, -2 log likelihood up to a
    constant, (C,).

    Args:
        normals: (N, 3) of :func:`body_planes`.
        down: (C, 3) unit candidates of the direction of gravity.
    """
    tilt = np.degrees(np.arcsin(np.clip(down @ normals.T, -1, 1))) / _AXIS_SIGMA_DEG
    return np.asarray(4 * np.log1p(tilt**2 / 4).sum(1))
