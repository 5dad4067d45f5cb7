"""Convert rotations from networks, matrices or vectors, to rotation vectors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray


def to_rotvecs(rotations: FloatArray, joints: int) -> FloatArray:
    """Convert rotation matrices or vectors to rotation vectors (N, joints, 3) float64, radians.

    Args:
        rotations: (N, joints, 3) or (N, 3 joints) rotation vectors, or (N, joints, 3, 3) matrices, approximately
            orthonormal. Non-finite or invalid rotations become NaN.
        joints: number of joints; it distinguishes matrices of one joint from vectors of three.

    Raises:
        ValueError: another shape.
    """
    from scipy.spatial.transform import Rotation

    given = np.asarray(rotations, np.float64)
    rows = len(given)
    if given.shape in {(rows, joints, 3), (rows, 3 * joints)}:
        return given.reshape(rows, joints, 3).copy()
    if given.shape != (rows, joints, 3, 3):
        raise ValueError(
            f"rotations of {joints} joints must be (N, {joints}, 3), (N, {3 * joints}) or (N, {joints}, 3, 3), "
            f"got {given.shape}"
        )
    flat = given.reshape(-1, 3, 3)
    out = np.full((len(flat), 3), np.nan)
    valid: BoolArray = np.asarray(np.isfinite(flat).all(axis=(1, 2)))
    valid[valid] = np.linalg.det(flat[valid]) > 1e-3  # a reflection or a collapse is not a rotation
    if valid.any():
        out[valid] = Rotation.from_matrix(flat[valid]).as_rotvec()
    return out.reshape(rows, joints, 3)
