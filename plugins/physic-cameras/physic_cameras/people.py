"""Who is who in photos whose cameras are known up to a scale, and that scale from the sizes of people.

A person of one photo and one of another are taken to be the same if the rays of their keypoints meet, and if the points
where they meet form the bodies that the photos show alone, at a scale that is the same for everybody.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from physic_cameras.rig import NEAREST, triangulate
from physic_core.body.convert.bodies import convert_bodies
from physic_core.body.landmarks import keypoints_on_body
from physic_core.body.parameters import rotations_from_parameters
from physic_core.types.bounds import Degrees, Positive, Share

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_cameras.rig import CameraRig
    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, FloatArray, IntArray, MomentView

LEAST_JOINTS = 6
"""Keypoints that two photos must see of a person: with fewer, bodies do not tell a scale."""
_SAME_SCALE = 0.05  # logarithms of scales that count as one candidate


@dataclass(frozen=True)
class PeopleSettings:
    """When two people in two photos are the same; each bound alone excludes a pair. Not chosen on photos.

    Attributes:
        confidence: least confidence of a keypoint that counts as seen.
        keypoint: largest median distance of keypoints from where their rays meet, as a share of the stature in px: the
            bound of the check ``view_keypoints``.
        shape: largest median distance of these points from the bodies of the photos, as a share of the body's size.
        scale: largest logarithm of the quotient of a person's scale and that of all.
        parallax: least angle between the two rays of a keypoint, median: below it, the scale is not known.
    """

    confidence: Share = 0.3
    keypoint: Positive = 0.06
    shape: Positive = 0.3
    scale: Positive = 0.3
    parallax: Degrees = 1.0


@dataclass(frozen=True)
class ShownPeople:
    """The N people of one photo, with J keypoints.

    Attributes:
        rays: (N, J, 2) keypoints as x / z and y / z.
        confidence: (N, J), 0 outside of the photo.
        landmarks: (N, J, 3) keypoints on the body that the photo shows alone, metres, of the known stature if there is
            one; NaN for keypoints that a body does not have.
        size: (N,) stature in the units of the rays.
        stature_known: (N,) bool.
    """

    rays: FloatArray
    confidence: FloatArray
    landmarks: FloatArray
    size: FloatArray
    stature_known: BoolArray

    def __len__(self) -> int:
        return len(self.rays)

    def with_focal(self, factor: float) -> ShownPeople:
        """Return the same people as a camera shows them whose focal length is multiplied."""
        return replace(self, rays=self.rays / factor, size=self.size / factor)


def shown_people(view: MomentView, model: BodyModel) -> ShownPeople:
    """Return what one photo says about its people.

    Args:
        view: the photo; bodies of another body model are converted.
        model: body model, float64.
    """
    camera, keypoints = view.intrinsics, view.keypoints
    parameters = convert_bodies(view.bodies, model).parameters
    with torch.inference_mode():
        rotations = rotations_from_parameters(parameters, dtype=torch.float64)
        betas, transl = (torch.from_numpy(np.asarray(x, np.float64)) for x in (parameters.betas, parameters.transl))
        body = model(rotations, betas, transl)
        on_body = model.landmarks(body, keypoints_on_body(keypoints).joint_set).numpy()
        stature = model.stature(betas).numpy()
    landmarks = np.full((*keypoints.points.shape[:2], 3), np.nan)
    landmarks[:, list(keypoints.joint_set.fitted)] = on_body
    known = np.isfinite(view.statures)
    distance = np.maximum(body.joints[:, 0, 2].numpy(), 0.1)
    points = np.asarray(keypoints.points, np.float64)
    inside = ((points > -0.5) & (points < np.array([camera.width, camera.height]) - 0.5)).all(-1)
    rays = (np.nan_to_num(points) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return ShownPeople(
        rays=rays,
        confidence=np.where(inside & np.isfinite(keypoints.confidence), keypoints.confidence, 0.0),
        landmarks=landmarks * np.where(known, view.statures / stature, 1.0)[:, None, None],
        size=stature / distance,
        stature_known=known,
    )


@dataclass(frozen=True)
class MatchedPeople:
    """People of several photos.

    Attributes:
        rows: (P, V) row of each person in each photo, -1 where not shown; each in at least two photos.
        scale: factor from the lengths of the rig to metres.
    """

    rows: IntArray
    scale: float


@dataclass(frozen=True)
class _Pair:
    """Two people of two photos, as if they were the same: ``fit`` in units of the bounds, and log(scale)."""

    fit: float
    log_scale: float


def match_across_photos(photos: Sequence[ShownPeople], rig: CameraRig, settings: PeopleSettings) -> MatchedPeople:
    """Return who is who, with the scale at which most people match best.

    Args:
        photos: V photos.
        rig: their cameras.
        settings: bounds of a match.
    """
    pairs: dict[tuple[int, int], dict[tuple[int, int], _Pair]] = {}
    for a, b in itertools.combinations(range(len(photos)), 2):
        both, two = (photos[a], photos[b]), rig.of((a, b))
        found = {(i, j): _fit(both, (i, j), two, settings) for i in range(len(both[0])) for j in range(len(both[1]))}
        pairs[a, b] = {people: pair for people, pair in found.items() if pair is not None}
    logs = np.array([pair.log_scale for found in pairs.values() for pair in found.values()])
    best: list[tuple[float, int, int, int, int, float]] = []
    for log_scale in np.unique((logs / _SAME_SCALE).round()) * _SAME_SCALE:
        chosen = [one for (a, b), found in pairs.items() for one in _assigned(a, b, found, log_scale, settings)]
        if sum(one[0] for one in chosen) > sum(one[0] for one in best):
            best = chosen
    scale = float(np.exp(np.median([one[-1] for one in best]))) if best else 1.0
    return MatchedPeople(_joined(best, len(photos)), scale)


def log_size_ratio(landmarks: FloatArray, points: FloatArray) -> float:
    """Return the logarithm of the size of a body over that of the same points (n, 3): median of distances in pairs."""
    a, b = np.triu_indices(len(points), 1)
    body, own = (np.linalg.norm(some[a] - some[b], axis=1) for some in (landmarks, points))
    return float(np.median(np.log(np.maximum(body, NEAREST) / np.maximum(own, 1e-9))))


def ray_errors(rays: FloatArray, local: FloatArray, size: FloatArray) -> FloatArray:
    """Return distances (...) of points (..., 3) in camera frames from rays (..., 2), as a share of the stature."""
    seen = local[..., :2] / np.maximum(local[..., 2:], NEAREST)
    errors: FloatArray = np.linalg.norm(seen - rays, axis=-1) / size
    return errors


def _fit(
    photos: tuple[ShownPeople, ShownPeople], people: tuple[int, int], rig: CameraRig, settings: PeopleSettings
) -> _Pair | None:
    """Return how well two people of two photos can be the same; None if they cannot."""
    rays = np.stack([photo.rays[i] for photo, i in zip(photos, people, strict=True)])
    landmarks = np.stack([photo.landmarks[i] for photo, i in zip(photos, people, strict=True)])
    confidence = np.stack([photo.confidence[i] for photo, i in zip(photos, people, strict=True)])
    size = np.array([photo.size[i] for photo, i in zip(photos, people, strict=True)])
    seen = (confidence >= settings.confidence).all(0) & np.isfinite(landmarks).all((0, 2))
    if seen.sum() < LEAST_JOINTS:
        return None
    rays, landmarks, confidence = rays[:, seen], landmarks[:, seen], confidence[:, seen]
    points = triangulate(rays, confidence, rig)
    local = rig.to_cameras(points)
    towards = points - rig.centres[:, None]
    cosine = (towards[0] * towards[1]).sum(-1) / np.linalg.norm(towards, axis=-1).prod(0)
    if (np.median(local[..., 2], axis=1) <= 0).any() or np.median(cosine) > np.cos(np.radians(settings.parallax)):
        return None
    error = np.median(ray_errors(rays, local, size[:, None]).max(0)) / settings.keypoint
    logs = [log_size_ratio(body, own) for body, own in zip(landmarks, local, strict=True)]
    shape = max(
        _distance(np.exp(log) * own, body) / settings.shape
        for log, own, body in zip(logs, local, landmarks, strict=True)
    )
    return _Pair(error**2 + shape**2, float(np.mean(logs))) if max(error, shape) < 1 else None


def _distance(points: FloatArray, body: FloatArray) -> float:
    """Return the median distance of points (n, 3) from a body, up to a translation, as a share of the body's size."""
    away = points - body
    spread = np.linalg.norm(body - body.mean(0), axis=1).max()
    return float(np.median(np.linalg.norm(away - np.median(away, axis=0), axis=1)) / spread)


def _assigned(
    a: int, b: int, found: dict[tuple[int, int], _Pair], log_scale: float, settings: PeopleSettings
) -> list[tuple[float, int, int, int, int, float]]:
    """Return the best assignment of two photos' people: score, photo and person twice, logarithm of the scale."""
    if not found:
        return []
    score = np.zeros([1 + max(people[side] for people in found) for side in range(2)])
    for people, pair in found.items():
        off = (pair.log_scale - log_scale) / settings.scale
        if abs(off) < 1:
            score[people] = 3 - pair.fit - off**2  # each bound adds up to one
    return [
        (float(score[i, j]), a, int(i), b, int(j), found[int(i), int(j)].log_scale)
        for i, j in zip(*linear_sum_assignment(score, maximize=True), strict=True)
        if score[i, j] > 0
    ]


def _joined(pairs: Sequence[tuple[float, int, int, int, int, float]], photos: int) -> IntArray:
    """Return the rows (P, V) of people who are linked by pairs, the best pairs first; one row of a photo for each."""
    groups: dict[tuple[int, int], dict[int, int]] = {}
    for _, a, i, b, j, _ in sorted(pairs, reverse=True):
        one, two = groups.setdefault((a, i), {a: i}), groups.setdefault((b, j), {b: j})
        if one is not two and not one.keys() & two.keys():
            one |= two
            for key in two.items():
                groups[key] = one
    rows = {tuple(group.get(v, -1) for v in range(photos)) for group in groups.values() if len(group) > 1}
    return np.array(sorted(rows, reverse=True), np.int64).reshape(-1, photos)
