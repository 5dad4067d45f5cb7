"""Give a relative point map the shape of a measured depth, where that is known.

The point map is aligned to the depth first. What is left, the ratio of both, is followed pixel by
pixel; its noise and its steps are those of the sensor, and the point map is smooth. Where the depth
is unknown, the trend of the ratio over place and depth continues it. OpenCV camera frame.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.engine.photo_content import PixelPoints
from physic_core.engine.scene.method import METRIC_DEPTH_TOLERANCE
from physic_core.engine.sizes.evidence import USUAL_DEPTH_M, median_depth
from physic_core.geometry.alignment import AlignmentOptions, apply_alignment, fit_alignment
from physic_core.geometry.pointmap import depth_to_pointmap
from physic_core.geometry.tensors import tensor, tensors

if TYPE_CHECKING:
    from physic_core.types import BoolArray, DepthMap, FloatArray, Intrinsics, Pointmap

_NOISE = 0.01
"""Largest difference from the measured depth that smoothing may leave, as a share of it."""

_REACH = 1 / 60
"""Width of the smoothing window, as a share of the long side: a few pixels of a phone's depth
sensor.
"""

_USUAL_MEDIAN = (0.1, 100.0)  # of the depth of a scene, metres

_SAMPLES = 20_000  # pixels of the trend
_REWEIGHTED = 10  # fits of the trend with new weights


def in_usual_unit(pointmap: Pointmap) -> Pointmap:
    """Return a point map of any unit whose median depth is that of a scene in metres: of another
    one, such as millimetres, its scale could be beyond those that are voted on.
    """
    median = median_depth(pointmap)
    low, high = _USUAL_MEDIAN
    factor = 1.0 if low <= median <= high else USUAL_DEPTH_M / median
    return replace(pointmap, points=pointmap.points * np.float32(factor))


def with_measured_shape(pointmap: Pointmap, depth: DepthMap, camera: Intrinsics) -> Pointmap:
    """Return a point map with the measured depth, metres, where that is known, and its own shape
    elsewhere.

    Args:
        pointmap: of the same picture, in any unit.
        depth: measured.
        camera: of the point map.
    """
    rays, metres = tensors(camera.matrix, depth.depth)
    has_depth = torch.isfinite(metres) & (metres > 0)
    target = depth_to_pointmap(torch.where(has_depth, metres, 1.0), rays)
    options = AlignmentOptions(METRIC_DEPTH_TOLERANCE)
    pixels = PixelPoints.of(pointmap)
    alignment = fit_alignment(
        pixels.points, target, pixels.valid & has_depth, pixels.unknown, options=options
    )
    aligned = apply_alignment(pixels.points, alignment)[..., 2]
    map_depth, measured = (each.numpy() for each in (aligned, has_depth))
    valid = pointmap.valid & np.isfinite(map_depth) & (map_depth > 0)
    overlap = valid & measured
    if not overlap.any():
        return pointmap
    map_depth = np.where(valid, map_depth, 1.0)
    ratio = np.log(np.where(overlap, depth.depth, map_depth) / map_depth)
    depths = np.where(
        valid,
        map_depth * np.exp(_continued(ratio, map_depth, overlap)),
        np.where(measured, depth.depth, 1.0),
    )
    points = np.where(
        (valid | measured)[..., None], depth_to_pointmap(tensor(depths), rays).numpy(), 0.0
    )
    return replace(
        pointmap,
        points=np.asarray(points, np.float32),
        valid=valid | measured,
        unknown="scale",
        shift_sigma=None,
    )


def shows_people(depth: DepthMap, photo: Pointmap, scene: Pointmap, masks: BoolArray) -> bool:
    """Return whether a depth is nearer to that of the photo than to that of the scene behind the
    people.

    Args:
        depth: measured.
        photo: with its people, of the shape of the depth elsewhere.
        scene: without them.
        masks: (N, H, W) bool, of the people.
    """
    common = masks.any(0) & np.isfinite(depth.depth) & photo.valid & scene.valid
    if not common.any():
        return False
    away = [
        np.median(np.abs(np.log(depth.depth[common] / one.points[common][:, 2])))
        for one in (photo, scene)
    ]
    return bool(away[0] < away[1])


def _continued(ratio: FloatArray, depth: FloatArray, known: BoolArray) -> FloatArray:
    """Return log ratios (H, W), smooth within the noise where they are known, and by their trend
    elsewhere.

    Args:
        ratio: (H, W) log ratios.
        depth: (H, W) of the point map, positive and finite.
        known: (H, W), which of them are known.
    """
    import cv2

    side = 2 * round(_REACH * max(ratio.shape) / 2) + 1
    share = cv2.blur(known.astype(np.float64), (side, side))
    smooth = cv2.blur(np.where(known, ratio, 0.0), (side, side)) / np.maximum(share, 1e-9)
    inside = np.clip(smooth, ratio - _NOISE, ratio + _NOISE)
    return np.where(known, inside, _smooth_trend(ratio, depth, known))


def _smooth_trend(ratio: FloatArray, depth: FloatArray, known: BoolArray) -> FloatArray:
    """Return the plane (H, W) through log ratios over column, row and log depth, of least absolute
    residuals.

    The nearest pixels of a person are often those of a far background, which has an error of its
    own.
    """
    rows, columns = np.mgrid[: ratio.shape[0], : ratio.shape[1]] / max(ratio.shape)
    terms = np.stack([columns, rows, np.log(depth), np.ones_like(depth)], -1)
    chosen = np.flatnonzero(known)
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _SAMPLES)).astype(int)]
    samples = terms.reshape(-1, 4)[chosen]
    target = ratio.ravel()[chosen]
    weight = np.ones(len(chosen))
    for _ in range(_REWEIGHTED):
        plane = np.linalg.lstsq(samples * weight[:, None], target * weight, rcond=None)[0]
        weight = np.abs(samples @ plane - target).clip(_NOISE) ** -0.5
    return np.asarray(terms @ plane)
