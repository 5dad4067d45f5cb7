"""People in several calibrated views of one moment: who is who, and where their joints are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.cameras import Camera

    Array = NDArray[np.float64]

LIMIT = 0.02
"""Error of a joint that still agrees, as a share of the picture's width: 38 px of 1920, or 10 cm at
4 m.
"""

MIN_JOINTS = 5
MIN_VIEWS = 3
"""Fewer joints of somebody, or fewer views, prove nothing: any two rays nearly meet somewhere."""

SEEN_JOINTS = 4
AGREEING_SHARE = 0.7
"""A further view belongs to a person where it sees this many of the joints, and this share of them
agrees.
"""


@dataclass(frozen=True)
class Triangulated:
    """One person: (12, 3) m in the world, NaN where views disagree, and which detection is theirs
    in each view.
    """

    joints: Array
    members: dict[int, int]
    error: float  # median, as a share of the picture's width


def triangulate(cameras: Sequence[Camera], points: Array) -> Array:
    """(J, 3) m from (V, J, 2) px by the direct linear transform; NaN for a joint that fewer than
    two views know.
    """
    joints = np.full((points.shape[1], 3), np.nan)
    P = np.stack([c.K @ np.column_stack([c.R, c.t]) / c.width for c in cameras])
    equations = points[..., None] * P[:, None, 2:] - P[:, None, :2]
    for j in range(points.shape[1]):
        is_known = np.isfinite(points[:, j]).all(-1)
        if is_known.sum() >= 2:
            solution = np.linalg.svd(equations[is_known, j].reshape(-1, 4))[2][-1]
            if abs(solution[3]) > 1e-9:
                joints[j] = solution[:3] / solution[3]
    return joints


def errors(cameras: Sequence[Camera], points: Array, joints: Array) -> Array:
    """(V, J) distance of projected joints from the points, as a share of the picture's width."""
    return np.stack(
        [
            np.linalg.norm(c.project(joints) - p, axis=-1) / c.width
            for c, p in zip(cameras, points, strict=True)
        ]
    )


def robust_joints(cameras: Sequence[Camera], points: Array) -> tuple[Array, Array]:
    """(J, 3) joints of the largest agreeing set of views of each, and (J,) median errors; NaN where
    too few agree.

    Three views have to agree. Two are enough where no other sees the joint, if they agree within
    half the limit.
    """
    agreed = np.zeros((len(cameras), points.shape[1]), bool)
    quality = np.zeros(points.shape[1])
    for pair in combinations(range(len(cameras)), 2):
        joints = triangulate([cameras[v] for v in pair], points[list(pair)])
        agreement = _agreement(errors(cameras, points, joints))
        better = agreement.sum(0) > quality
        quality[better] = agreement.sum(0)[better]
        agreed[:, better] = agreement[:, better] > 0
    count = agreed.sum(0)
    view_count = np.isfinite(points).all(-1).sum(0)
    kept = np.where((agreed & (count >= 2))[..., None], points, np.nan)
    joints = triangulate(cameras, kept)
    error = np.array(
        [
            np.median(e[np.isfinite(e)]) if np.isfinite(e).any() else np.nan
            for e in errors(cameras, kept, joints).T
        ]
    )
    with np.errstate(invalid="ignore"):
        enough = (count >= MIN_VIEWS) | ((count == 2) & (view_count == 2) & (error < LIMIT / 2))
    return np.where(enough[:, None], joints, np.nan), np.where(enough, error, np.nan)


def _agreement(error: Array) -> Array:
    """1 of an exact point, 0 of one at the limit, beyond it or unknown."""
    return np.clip(1 - np.nan_to_num(error, nan=np.inf) / LIMIT, 0, 1)


def match_views(cameras: Sequence[Camera], views: Sequence[Sequence[Array]]) -> list[Triangulated]:
    """People that several views agree about, most views first.

    Each pair of detections in two views is a hypothesis; in every other view the detection that
    agrees with most of its joints belongs to it. The hypothesis with the most agreeing joints is
    accepted, its detections leave, and so on.

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
                    best = max(
                        best, _hypothesis(cameras, views, free, {a: i, b: j}), key=lambda h: h[0]
                    )
        members = best[1]
        if len(members) < MIN_VIEWS:
            return people
        used = sorted(members)
        joints, error = robust_joints(
            [cameras[v] for v in used], np.stack([views[v][members[v]] for v in used])
        )
        for v in used:
            free[v].discard(members[v])
        if np.isfinite(joints).all(-1).sum() >= MIN_JOINTS:
            people.append(Triangulated(joints, members, float(np.nanmedian(error))))


def _hypothesis(
    cameras: Sequence[Camera],
    views: Sequence[Sequence[Array]],
    free: Sequence[set[int]],
    pair: dict[int, int],
) -> tuple[float, dict[int, int]]:
    """How well detections of all views agree with the joints of a pair, and which they are; 0 of
    fewer than three.
    """
    used = [cameras[v] for v in pair]
    points = np.stack([views[v][i] for v, i in pair.items()])
    joints = triangulate(used, points)
    agreement = _agreement(errors(used, points, joints)).min(0)
    if (agreement > 0).sum() < max(MIN_JOINTS, AGREEING_SHARE * np.isfinite(joints).all(-1).sum()):
        return 0.0, {}
    joints = np.where((agreement > 0)[:, None], joints, np.nan)
    members = dict(pair)
    total = float(agreement.sum())
    for v in range(len(cameras)):
        if v in pair:
            continue
        values = {i: _support(cameras[v], views[v][i], joints) for i in free[v]}
        best = max(values, key=lambda i: values[i], default=-1)
        if best >= 0 and values[best] > 0:
            members[v] = best
            total += values[best]
    return total if len(members) >= MIN_VIEWS else 0.0, members


def _support(camera: Camera, points: Array, joints: Array) -> float:
    """Agreement of a detection with joints of the world; 0 where it is not theirs."""
    error = errors([camera], points[None], joints)[0]
    agreement = _agreement(error)
    joint_count = int(np.isfinite(error).sum())
    if joint_count < SEEN_JOINTS or (agreement > 0).sum() < AGREEING_SHARE * joint_count:
        return 0.0
    return float(agreement.sum())


def visible_joints(camera: Camera, joints: Array) -> NDArray[np.bool_]:
    """(J,) bool: which joints of the world fall into the picture; what hides them is not known."""
    pixels = camera.project(joints)
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= 0) & (pixels < [camera.width, camera.height])).all(-1))
