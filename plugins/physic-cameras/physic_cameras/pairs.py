"""Poses of cameras from matched pixels: essential matrices of pairs of photos, chained along the best-linked tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_cameras.bundle import (
    BundleProblem,
    BundleSettings,
    CalibratedRig,
    CameraPosePrior,
    Matches,
    Sightings,
    adjust,
)
from physic_cameras.people import PeopleSettings, ShownPeople, match_across_photos
from physic_cameras.rig import CameraRig, known_motion
from physic_cameras.solution import fixed_cameras, focal_sigmas
from physic_core.types.bounds import Positive, PositiveCount

if TYPE_CHECKING:
    from physic_core.types import FloatArray, MomentView

_CERTAIN = 0.9999
_WIDTH = 1000.0
_ROUGH = 2.0  # factor on the bound of keypoints, before focal lengths are adjusted
_ROUGH_TURN, _ROUGH_LENGTH = 0.3, 0.3  # radians, and share of the distance between cameras: errors of the chain


@dataclass(frozen=True)
class PairSettings:
    """Settings of the essential matrices. Not chosen on photos.

    Attributes:
        inlier_px: largest distance from the epipolar line, px of a photo 1000 px wide.
        inliers: least matches that agree with one motion between two cameras: wrong matches of two rooms agree in
            fives to tens.
        error_px: standard deviation of that distance, in the same px.
        used: most matches of a pair in the bundle adjustment: errors of neighbouring pixels are not independent.
    """

    inlier_px: Positive = 1.5
    inliers: PositiveCount = 25
    error_px: Positive = 1.0
    used: PositiveCount = 300


@dataclass(frozen=True)
class Link:
    """Two photos with the same background.

    Attributes:
        rotation: (3, 3) from the first camera to the second.
        translation: (3,) of the same motion, metres.
        matches: of the photos 0 and 1; some are wrong.
        is_known: whether the user states it.
    """

    rotation: FloatArray
    translation: FloatArray
    matches: Matches
    is_known: bool = False


def known_link(one: MomentView, two: MomentView) -> Link:
    """Return the motion between two cameras of known pose, without matches."""
    assert one.pose is not None
    assert two.pose is not None
    rotation, translation = known_motion(one.pose, two.pose)
    return Link(rotation, translation, Matches.none(), is_known=True)


def link(
    pixels: FloatArray,
    views: tuple[MomentView, MomentView],
    people: tuple[ShownPeople, ShownPeople],
    log_focal: FloatArray,
    settings: PairSettings,
    who: PeopleSettings,
) -> Link | None:
    """Return the motion between two cameras, or None if the photos have too few matches, or no person in common.

    The essential matrix is found by MAGSAC++; the length of the translation follows from the sizes of the people of
    both photos.

    Args:
        pixels: (m, 2, 2) px of matches in both photos.
        views: the photos.
        people: of the photos.
        log_focal: (2,) logarithm of the factor on both focal lengths.
        settings: of the essential matrix.
        who: when two people are the same.
    """
    if len(pixels) < settings.inliers:
        return None
    pixels = pixels[:: -(-len(pixels) // settings.used)]
    cameras, focal = [view.intrinsics for view in views], np.exp(log_focal)
    rays = np.stack([(pixels[:, k] - [c.cx, c.cy]) / [c.fx, c.fy] for k, c in enumerate(cameras)], axis=1)
    unit = float(np.exp(np.mean([np.log(max(c.width, c.height) / _WIDTH / c.fx) for c in cameras])))
    one, two = np.ascontiguousarray((rays / focal[:, None]).transpose(1, 0, 2))
    threshold = settings.inlier_px * unit / float(np.sqrt(focal.prod()))
    essential, near = cv2.findEssentialMat(one, two, np.eye(3), cv2.USAC_MAGSAC, _CERTAIN, threshold)
    if essential is None or essential.shape != (3, 3):
        return None
    count, rotation, translation, _ = cv2.recoverPose(essential, one, two, np.eye(3), mask=near)
    if count < settings.inliers:
        return None
    rig = CameraRig(np.stack([np.eye(3), rotation]), np.stack([np.zeros(3), translation[:, 0]]))
    seen = [photo.with_focal(factor) for photo, factor in zip(people, focal.tolist(), strict=True)]
    matched = match_across_photos(seen, rig, replace(who, keypoint=_ROUGH * who.keypoint))
    if not len(matched.rows):
        return None
    matches = Matches(np.tile([0, 1], (len(rays), 1)), rays, np.full(len(rays), settings.error_px * unit))
    return Link(rotation, matched.scale * translation[:, 0], matches)


def chained(
    links: Mapping[tuple[int, int], Link], views: Sequence[MomentView], log_focal: FloatArray, bundle: BundleSettings
) -> tuple[list[int], CalibratedRig, Matches]:
    """Return the photos of the tree with most matches, their cameras, and all matches between them.

    Known motions come first. The cameras start from the motions along the tree, and are adjusted to the matches. Photos
    are numbered in the order of the tree, and the frame is that of the first one.

    Args:
        links: of pairs of photos a < b; at least one.
        views: all V photos.
        log_focal: (V,) logarithms of the factors on the focal lengths with which the links were found.
        bundle: of the adjustment.
    """
    size = {pair: np.inf if one.is_known else len(one.matches.sigma) for pair, one in links.items()}
    linked = [sum(n for pair, n in size.items() if v in pair) for v in range(len(views))]
    order = [int(np.argmax(linked))]
    rig = CameraRig(np.eye(3)[None], np.zeros((1, 3)))
    while reach := {pair: n for pair, n in size.items() if (pair[0] in order) != (pair[1] in order)}:
        a, b = max(reach, key=lambda pair: reach[pair])
        rotation, translation = links[a, b].rotation, links[a, b].translation
        if b in order:
            a, b, rotation, translation = b, a, rotation.T, -rotation.T @ translation
        rotation, translation = rig.joined(order.index(a), rotation, translation)
        rig = CameraRig(
            np.concatenate([rig.rotation, rotation[None]]), np.concatenate([rig.translation, translation[None]])
        )
        order.append(b)
    used = {pair: one for pair, one in links.items() if pair[0] in order}
    matches = Matches(
        np.concatenate(
            [np.tile([order.index(v) for v in pair], (len(m.matches.sigma), 1)) for pair, m in used.items()]
        ),
        np.concatenate([one.matches.rays for one in used.values()]),
        np.concatenate([one.matches.sigma for one in used.values()]),
    )
    # Matched pixels do not compare the lengths of two motions: those that people tell stay nearly.
    prior = CameraPosePrior(rig, _ROUGH_TURN, _ROUGH_LENGTH * float(np.linalg.norm(rig.centres, axis=1).mean()))
    chosen = [views[v] for v in order]
    fixed = fixed_cameras(chosen, 0)
    problem = BundleProblem(Sightings.none(len(order)), matches, focal_sigmas(chosen), fixed, prior)
    return order, adjust(problem, CalibratedRig(rig, log_focal[order]), bundle).cameras, matches
