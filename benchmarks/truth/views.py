"""People in several calibrated views of one moment: who is who, and where their joints are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .cameras import Camera

    Array = NDArray[np.float64]

LIMIT = 0.02
"""Error of a joint that still agrees, as a share of the picture's width: 38 px of 1920, or 10 cm at 4 m."""

MIN_JOINTS, MIN_VIEWS = 6, 3
"""Fewer joints of somebody, or fewer views of a joint, prove nothing: any two rays nearly meet somewhere."""


@dataclass(frozen=True)
class Triangulated:
    """One person: (12, 3) m in the world, NaN where views disagree, and which detection is theirs in each view."""

    joints: Array
    members: dict[int, int]
    error: float  # median, as a share of the picture's width


def triangulate(cameras: Sequence[Camera], points: Array) -> Array:
    """(J, 3) m from (V, J, 2) px by the direct linear transform; NaN for a joint that fewer than two views know."""
    joints = np.full((points.shape[1], 3), np.nan)
    for j in range(points.shape[1]):
        rows = []
        for camera, point in zip(cameras, points[:, j], strict=True):
            if np.isfinite(point).all():
                P = camera.K @ np.column_stack([camera.R, camera.t])
                P, xy = P / camera.width, point / camera.width
                rows += [xy[0] * P[2] * camera.width - P[0], xy[1] * P[2] * camera.width - P[1]]
        if len(rows) >= 4:
            solution = np.linalg.svd(np.array(rows))[2][-1]
            if abs(solution[3]) > 1e-9:
                joints[j] = solution[:3] / solution[3]
    return joints


def errors(cameras: Sequence[Camera], points: Array, joints: Array) -> Array:
    """(V, J) distance of projected joints from the points, as a share of the picture's width."""
    return np.stack(
        [np.linalg.norm(c.project(joints) - p, axis=-1) / c.width for c, p in zip(cameras, points, strict=True)]
    )


def robust_joints(cameras: Sequence[Camera], points: Array, min_views: int = MIN_VIEWS) -> tuple[Array, Array]:
    """(J, 3) joints of the largest agreeing set of views of each, and (J,) median errors; NaN where too few agree."""
    agreed = np.zeros((len(cameras), points.shape[1]), bool)
    quality = np.full(points.shape[1], -np.inf)
    for pair in combinations(range(len(cameras)), 2):
        joints = triangulate([cameras[v] for v in pair], points[list(pair)])
        error = errors(cameras, points, joints)
        with np.errstate(invalid="ignore"):
            within = error < LIMIT
        value = within.sum(0) - np.where(within, error, 0).sum(0)
        better = value > quality
        quality[better] = value[better]
        agreed[:, better] = within[:, better]
    kept = np.where((agreed & (agreed.sum(0) >= min_views))[..., None], points, np.nan)
    best = triangulate(cameras, kept)
    error = errors(cameras, kept, best)
    return best, np.array([np.median(e[np.isfinite(e)]) if np.isfinite(e).any() else np.nan for e in error.T])


def match_views(cameras: Sequence[Camera], views: Sequence[Sequence[Array]]) -> list[Triangulated]:
    """People that several views agree about, most views first.

    Each pair of detections in two views is a hypothesis; in every other view the detection that agrees with most of its
    joints belongs to it. The hypothesis with the most agreeing joints is accepted, its detections leave, and so on.

    Args:
        cameras: of V views.
        views: per view a list of (12, 2) px, NaN where a joint is not seen.
    """
    free = [set(range(len(view))) for view in views]
    people: list[Triangulated] = []
    while True:
        best: tuple[float, dict[int, int]] = (0.0, {})
        for a, b in combinations(range(len(cameras)), 2):
            for i in free[a]:
                for j in free[b]:
                    best = max(best, _hypothesis(cameras, views, free, {a: i, b: j}), key=lambda h: h[0])
        members = best[1]
        if len(members) < MIN_VIEWS:
            return people
        used = sorted(members)
        joints, error = robust_joints([cameras[v] for v in used], np.stack([views[v][members[v]] for v in used]))
        for v in used:
            free[v].discard(members[v])
        if np.isfinite(joints).all(-1).sum() >= MIN_JOINTS:
            people.append(Triangulated(joints, members, float(np.nanmedian(error))))


def _hypothesis(
    cameras: Sequence[Camera], views: Sequence[Sequence[Array]], free: Sequence[set[int]], pair: dict[int, int]
) -> tuple[float, dict[int, int]]:
    used = list(pair)
    points = np.stack([views[v][pair[v]] for v in used])
    joints = triangulate([cameras[v] for v in used], points)
    with np.errstate(invalid="ignore"):
        agree = (errors([cameras[v] for v in used], points, joints) < LIMIT).all(0)
    if agree.sum() < MIN_JOINTS:
        return 0.0, {}
    members, total = dict(pair), float(agree.sum())
    for v in range(len(cameras)):
        if v in pair:
            continue
        counts = {i: _agreeing(cameras[v], views[v][i], joints, agree) for i in free[v]}
        if counts and max(counts.values()) >= MIN_JOINTS:
            members[v] = max(counts, key=lambda i: counts[i])
            total += counts[members[v]]
    return total if len(members) >= MIN_VIEWS else 0.0, members


def _agreeing(camera: Camera, points: Array, joints: Array, counted: NDArray[np.bool_]) -> float:
    error = errors([camera], points[None], joints)[0]
    with np.errstate(invalid="ignore"):
        within = counted & (error < LIMIT)
    return float(within.sum()) - float(error[within].sum())


def visible_joints(camera: Camera, joints: Array) -> NDArray[np.bool_]:
    """(J,) bool: which joints of the world fall into the picture; what hides them is not known."""
    pixels = camera.project(joints)
    with np.errstate(invalid="ignore"):
        inside: NDArray[np.bool_] = ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(-1)
    return inside
