"""Joint and vertex errors of each person, in millimetres: MPJPE, PA-MPJPE and MPVPE.

Points are metres in the OpenCV camera frame (x right, y down, z forward). As in the paper (sec.
4.1), MPJPE and MPVPE use no alignment, so that they include the error of the distance from the
camera. PA-MPJPE aligns each person by a similarity transform. The paper does not name the joints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.metrics.shapes import require_same_shape

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

BODY_JOINTS = slice(0, 22)
"""Pelvis to wrists, of the 55 joints in SMPL-X order: those that all SMPL-family bodies have."""


def mpjpe_mm(
    predicted: FloatArray, truth: FloatArray, valid: BoolArray | None = None
) -> FloatArray:
    """Return the mean per-joint position error, without alignment.

    Args:
        predicted: (..., J, 3) m, camera frame.
        truth: (..., J, 3) m.
        valid: (..., J) bool, joints that count; all if None.

    Returns:
        (...,) float64 mm; NaN if no joint counts, or a joint that counts is not finite.

    Raises:
        PhysicError: the shapes differ.
    """
    require_same_shape("joints", predicted, truth)
    return _mean_distance_mm(predicted, truth, valid)


def mpvpe_mm(
    predicted: FloatArray, truth: FloatArray, valid: BoolArray | None = None
) -> FloatArray:
    """Return the mean per-vertex position error, without alignment; arguments (..., V, 3) as in
    :func:`mpjpe_mm`.

    Raises:
        PhysicError: the shapes differ.
    """
    require_same_shape("vertices", predicted, truth)
    return _mean_distance_mm(predicted, truth, valid)


def pa_mpjpe_mm(
    predicted: FloatArray, truth: FloatArray, valid: BoolArray | None = None
) -> FloatArray:
    """Return the mean per-joint position error after :func:`align_similarity`; arguments as in
    :func:`mpjpe_mm`.

    Raises:
        PhysicError: the shapes differ.
    """
    return _mean_distance_mm(align_similarity(predicted, truth, valid), truth, valid)


def align_similarity(
    predicted: FloatArray, truth: FloatArray, valid: BoolArray | None = None
) -> FloatArray:
    """Align predicted points (..., J, 3) to the truth by a least-squares similarity transform
    without reflection.

    The transform is fitted to the valid points and applied to all (Umeyama, Least-squares
    estimation of transformation parameters between two point patterns, PAMI 1991). Coinciding
    points go to the centroid of the truth. A person without valid points, or with a non-finite one,
    becomes NaN.

    Raises:
        PhysicError: the shapes differ.
    """
    require_same_shape("joints", predicted, truth)
    counted = (
        np.ones(truth.shape[:-1], bool)
        if valid is None
        else np.broadcast_to(valid, truth.shape[:-1])
    )
    source = np.where(counted[..., None], np.asarray(predicted, np.float64), 0.0)
    target = np.where(counted[..., None], np.asarray(truth, np.float64), 0.0)
    usable = counted.any(-1) & np.isfinite(source).all((-2, -1)) & np.isfinite(target).all((-2, -1))
    aligned = np.full(truth.shape, np.nan)
    if not usable.any():
        return aligned
    weights = counted[usable] / counted[usable].sum(-1, keepdims=True)
    # Centred for accuracy far from the origin.
    source_mean = (weights[..., None] * source[usable]).sum(-2, keepdims=True)
    target_mean = (weights[..., None] * target[usable]).sum(-2, keepdims=True)
    least = 1e-12 * (1.0 + np.abs(source_mean).max((-2, -1)))
    centred = source[usable] - source_mean
    linear = _turn_and_scale(centred, target[usable] - target_mean, weights, least)
    with np.errstate(invalid="ignore"):  # invalid points may not be finite
        every = np.asarray(predicted, np.float64)[usable] - source_mean
        aligned[usable] = np.einsum("nij,nkj->nki", linear, every) + target_mean
    return aligned


def _turn_and_scale(
    source: FloatArray, target: FloatArray, weights: FloatArray, least: FloatArray
) -> FloatArray:
    """Return the scaled rotations (n, 3, 3) from centred points (n, J, 3) to others; 0 of points
    that are not larger than ``least`` (n,).
    """
    import roma
    import torch

    size = np.sqrt((weights * np.square(source).sum(-1)).sum(-1))
    rotation, scale = roma.rigid_vectors_registration(
        *(torch.from_numpy(np.ascontiguousarray(array)) for array in (source, target, weights)),
        compute_scaling=True,
    )
    linear: FloatArray = (
        rotation.numpy() * np.where(size <= least, 0.0, scale.numpy())[:, None, None]
    )
    return linear


def _mean_distance_mm(
    predicted: FloatArray, truth: FloatArray, valid: BoolArray | None
) -> FloatArray:
    with np.errstate(invalid="ignore"):  # inf - inf
        distance = np.linalg.norm(
            np.asarray(predicted, np.float64) - np.asarray(truth, np.float64), axis=-1
        )
    counted = (
        np.ones(distance.shape, bool) if valid is None else np.broadcast_to(valid, distance.shape)
    )
    count = counted.sum(-1)
    total = np.where(counted, distance, 0.0).sum(-1)
    return np.where((count > 0) & np.isfinite(total), 1000.0 * total / np.maximum(count, 1), np.nan)
