"""From cameras up to a scale to the metric solution of a moment: who is who, bundle adjustment, scale, and errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_cameras.bundle import (
    Adjusted,
    BundleProblem,
    BundleSettings,
    CalibratedRig,
    CameraPosePrior,
    Matches,
    Sightings,
    adjust,
)
from physic_cameras.people import PeopleSettings, ShownPeople, log_size_ratio, match_across_photos
from physic_core.errors import InputError
from physic_core.interfaces import Options
from physic_core.types import CameraTrust, SkippedPhoto, SolvedCameras
from physic_core.types.bounds import Positive

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, IntArray, MomentView

_FIXED_FOCAL, _KNOWN_FOCAL, _ESTIMATED_FOCAL, _GUESSED_FOCAL = 1e-6, 0.003, 0.2, 0.3
_KNOWN_STATURE = 0.01
_ROUNDS = 3  # of matching people and adjusting cameras


class SolverOptions(Options):
    """Settings that the solvers of this plugin share."""

    people: PeopleSettings = Field(PeopleSettings(), description="when people of two photos are the same")
    bundle: BundleSettings = Field(BundleSettings(), description="bundle adjustment")
    body_sigma: Positive = Field(
        0.08,
        description="error of the logarithm of the sizes of all bodies, and so of the scale: single photos err alike, "
        "so that more people do not make it smaller. Not chosen on photos.",
    )


@dataclass(frozen=True)
class PhotoWithStart:
    """A photo whose camera has a start.

    Attributes:
        index: of the photo, as it was given.
        view: what it shows.
        people: of the view.
    """

    index: int
    view: MomentView
    people: ShownPeople


@dataclass(frozen=True)
class Evidence:
    """What is known of the cameras of V photos besides their people.

    Attributes:
        cameras: to start from; in metres if two poses are known, else in lengths of their own.
        matches: of the background.
        rotation_sigma: of the poses, radians; infinite if they are only a start.
        position_share: of their camera centres, as a share of the mean distance between cameras; the same.
    """

    cameras: CalibratedRig
    matches: Matches
    rotation_sigma: float = np.inf
    position_share: float = np.inf

    def of(self, views: Sequence[int]) -> Evidence:
        """Return the evidence of some of the photos."""
        number = np.full(len(self.cameras.rig), -1)
        number[list(views)] = np.arange(len(views))
        both = np.asarray((number[self.matches.views] >= 0).all(1))
        matches = replace(self.matches.of(both), views=number[self.matches.views[both]])
        cameras = CalibratedRig(self.cameras.rig.of(views), self.cameras.log_focal[list(views)])
        return replace(self, cameras=cameras, matches=matches)

    def prior(self, start: CalibratedRig, reference: int) -> CameraPosePrior | None:
        """Return the poses as evidence, at the scale of a start."""
        if not np.isfinite(self.rotation_sigma):
            return None
        own = self.cameras.rig.relative_to(reference)
        extent, before = (float(np.linalg.norm(rig.centres, axis=1).sum()) for rig in (start.rig, own))
        sigma = self.position_share * extent / (len(own) - 1)
        return CameraPosePrior(own.scaled(extent / before), self.rotation_sigma, sigma)


def focal_sigmas(views: Sequence[MomentView]) -> FloatArray:
    """Return the standard deviations (V,) of the logarithms of focal lengths; plain ones where none is stated.

    Those of cameras of known pose stay.
    """
    plain = {CameraTrust.KNOWN: _KNOWN_FOCAL, CameraTrust.ESTIMATED: _ESTIMATED_FOCAL}
    stated = [view.intrinsics.focal_sigma or plain.get(view.intrinsics.trust, _GUESSED_FOCAL) for view in views]
    return np.where([view.pose is not None for view in views], _FIXED_FOCAL, stated)


def fixed_cameras(views: Sequence[MomentView], reference: int) -> BoolArray:
    """Return which of the poses (V,) stay: those that the user states, and that of the reference.

    If there are known poses, the reference must have one.
    """
    return np.array([v == reference or view.pose is not None for v, view in enumerate(views)], bool)


def skipped_photo(index: int, view: MomentView, reason: str, why: str) -> SkippedPhoto:
    """Return the record of a photo that is not part of the solution."""
    return SkippedPhoto(view.name, index, reason, f"{view.name} is skipped: {why}")


def solved(
    views: Sequence[MomentView],
    photos: Sequence[PhotoWithStart],
    evidence: Evidence,
    skipped: Sequence[SkippedPhoto],
    options: SolverOptions,
    diagnostics: Mapping[str, Any],
) -> SolvedCameras:
    """Return the solution for all photos, of which some are used.

    Args:
        views: all photos.
        photos: the V photos that are used.
        evidence: of their cameras.
        skipped: the other photos.
        options: of all steps.
        diagnostics: for the record.

    Raises:
        InputError: no two photos share a person.
    """
    cameras = evidence.cameras
    rows: IntArray = np.zeros((0, len(photos)), np.int64)
    for _ in range(_ROUNDS):
        factors = np.exp(cameras.log_focal).tolist()
        matched = match_across_photos(
            [photo.people.with_focal(factor) for photo, factor in zip(photos, factors, strict=True)],
            cameras.rig,
            options.people,
        )
        if len(rows) and np.array_equal(rows, matched.rows):
            break
        rows = matched.rows
        kept = np.flatnonzero((rows >= 0).any(0)).tolist()
        if not kept:
            raise InputError(_no_shared_person(photos, skipped))
        if len(kept) < len(photos):
            why = "no person in it is where another photo shows one"
            lost = [photo for v, photo in enumerate(photos) if v not in kept]
            more = [skipped_photo(photo.index, photo.view, "other people", why) for photo in lost]
            rest = [photos[v] for v in kept]
            return solved(views, rest, evidence.of(kept), [*skipped, *more], options, diagnostics)
        reference = _reference(rows, photos)
        rig = cameras.rig.scaled(1.0 if _scale_is_known(photos) else matched.scale).relative_to(reference)
        start = CalibratedRig(rig, cameras.log_focal)
        adjusted, points = _adjusted(rows, photos, start, reference, evidence, options)
        cameras = adjusted.cameras
    factor, scale_sigma = (1.0, 0.0) if _scale_is_known(photos) else _scale(rows, photos, points, options)
    rig = cameras.rig.scaled(factor)

    def of_all(values: Any, *, otherwise: Any = np.nan) -> Any:
        """Return values (V, ...) of the photos that are used for all photos."""
        values = np.asarray(values)
        every = np.full((len(views), *values.shape[1:]), otherwise, values.dtype)
        every[[photo.index for photo in photos]] = values
        return every

    intrinsics = [view.intrinsics for view in views]
    for photo, log_focal, sigma in zip(photos, cameras.log_focal, adjusted.focal_sigma, strict=True):
        if photo.view.pose is None:
            intrinsics[photo.index] = photo.view.intrinsics.with_solved_focal(float(np.exp(log_focal)), float(sigma))
    distance = np.linalg.norm(rig.centres, axis=1)
    return SolvedCameras(
        reference=photos[reference].index,
        rotation=of_all(rig.rotation),
        translation=of_all(rig.translation),
        intrinsics=tuple(intrinsics),
        rotation_sigma=of_all(adjusted.rotation_sigma),
        position_sigma=of_all(np.hypot(factor * adjusted.position_sigma, distance * scale_sigma)),
        people=of_all(rows.T, otherwise=-1).T,
        points=factor * points,
        scale_sigma=scale_sigma,
        skipped=tuple(sorted(skipped, key=lambda one: one.index)),
        diagnostics=diagnostics,
    )


def _no_shared_person(photos: Sequence[PhotoWithStart], skipped: Sequence[SkippedPhoto]) -> str:
    names = [photo.view.name for photo in photos]
    rest = "".join(f"; {one.message}" for one in skipped)
    return (
        f"no person of {', '.join(names[:-1])} and {names[-1]} is where another of these photos shows one, with the "
        f"cameras that follow from the pictures{rest}: give photos that were taken at the same moment, with a person "
        "in common"
    )


def _reference(rows: IntArray, photos: Sequence[PhotoWithStart]) -> int:
    """Return the photo that shows most people, and of several the one that shows most of their keypoints.

    Photos of known pose come first.
    """

    def rank(v: int) -> tuple[bool, int, float]:
        own = rows[rows[:, v] >= 0, v]
        return photos[v].view.pose is not None, len(own), float(photos[v].people.confidence[own].sum())

    return max(range(len(photos)), key=rank)


def _scale_is_known(photos: Sequence[PhotoWithStart]) -> bool:
    """Return whether two poses are known."""
    return sum(photo.view.pose is not None for photo in photos) > 1


def _adjusted(
    rows: IntArray,
    photos: Sequence[PhotoWithStart],
    start: CalibratedRig,
    reference: int,
    evidence: Evidence,
    options: SolverOptions,
) -> tuple[Adjusted, FloatArray]:
    """Return adjusted cameras, and keypoints (P, J, 3) of people, NaN where fewer than two photos see one."""
    own = np.maximum(rows.T, 0)
    rays = np.stack([photo.people.rays[own[v]] for v, photo in enumerate(photos)])
    confidence = np.stack([photo.people.confidence[own[v]] for v, photo in enumerate(photos)])
    size = np.stack([photo.people.size[own[v]] for v, photo in enumerate(photos)])
    seen = (confidence >= options.people.confidence) & (rows.T >= 0)[..., None]
    weight = np.where(seen & (seen.sum(0) > 1), confidence, 0) / (options.bundle.keypoint * size[..., None])
    sightings = Sightings(rays.reshape(len(photos), -1, 2), weight.reshape(len(photos), -1))
    views = [photo.view for photo in photos]
    prior = evidence.prior(start, reference)
    problem = BundleProblem(sightings, evidence.matches, focal_sigmas(views), fixed_cameras(views, reference), prior)
    found = adjust(problem, start, options.bundle)
    return found, found.cameras.points(sightings).reshape(*rays.shape[1:3], 3)


def _scale(
    rows: IntArray, photos: Sequence[PhotoWithStart], points: FloatArray, options: SolverOptions
) -> tuple[float, float]:
    """Return the factor that gives people their sizes, and the standard deviation of its logarithm.

    It is the median over people, of known statures only if there are any.
    """
    logs, known = [], []
    for row, own in zip(rows.tolist(), points, strict=True):
        shown = [(photo.people, i) for photo, i in zip(photos, row, strict=True) if i >= 0]
        ratios = []
        for people, i in shown:
            both = np.isfinite(people.landmarks[i] + own).all(1)
            ratios.append(log_size_ratio(people.landmarks[i, both], own[both]))
        logs.append(np.mean(ratios))
        known.append(any(people.stature_known[i] for people, i in shown))
    chosen = [log for log, is_known in zip(logs, known, strict=True) if is_known or not any(known)]
    return float(np.exp(np.median(chosen))), _KNOWN_STATURE if any(known) else options.body_sigma
