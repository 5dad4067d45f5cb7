"""Cameras and people of the chosen photos: start, bundle adjustment, and one body for each person.

A person is assumed to hold still between photos. A person who does not fit has moved, and a photo
that most people do not fit is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.sizes.scale_vote import Witnesses, vote_on_scale
from physic_core.engine.sizes.stature import stature_sigmas
from physic_core.errors import InputError
from physic_core.types import CameraTrust, Intrinsics, ShortRepr
from physic_scene.bodies import MeanBodies, mean_bodies
from physic_scene.bundle import (
    KNOWN_CAMERAS,
    SOLVED_CAMERAS,
    Bundle,
    MomentObservations,
    adjust,
    camera_sigmas,
    project,
)
from physic_scene.photos import ChosenPhotos, ScenePhoto
from physic_scene.rigid import CameraPose
from physic_scene.triangulation import sizes_by_cameras

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, FloatArray, IntArray
    from physic_scene.observations import PhotoPeople
    from physic_scene.types import SkippedPhoto

_MOST_OFF = 0.06
"""Largest median distance of a person's solved keypoints from those of a photo, as a share of the
stature in px: the bound of ``view_keypoints``. Of 30 pairs of photos of a rig, right matches have
up to 0.032.
"""

_KNOWN_BONE = 0.01
_SURE = 0.9  # probability that a person of unknown stature is an adult
_SEEN = 0.3  # confidence of a keypoint


@dataclass(frozen=True)
class SolvedScene(ShortRepr):
    """Cameras and bodies of one moment, in the frame of the reference camera, metres; V photos are
    in the solution.

    Attributes:
        photos: V photos in the solution.
        left_out: the other photos.
        reference: index into ``photos``.
        rows: (P, V) row of each solved person in each photo, -1 where not shown.
        photos_of_moved: names of the photos that show one person in different places or poses, who
            is not solved.
        observations: of the solved people.
        bundle: cameras and points.
        intrinsics: of each photo, solved.
        rotation_sigma: (V,) radians.
        position_sigma: (V,) metres.
        bodies: of the solved people.
        errors: (V, P) median distance of keypoints, as a share of the stature in px; NaN where not
            shown.
        statures: (P,) metres, known ones of the solved people, NaN where unknown.
        scale_sigma: of the logarithm of all lengths.
    """

    photos: tuple[ScenePhoto, ...]
    left_out: tuple[SkippedPhoto, ...]
    reference: int
    rows: IntArray
    photos_of_moved: tuple[str, ...]
    observations: MomentObservations
    bundle: Bundle
    intrinsics: tuple[Intrinsics, ...]
    rotation_sigma: FloatArray
    position_sigma: FloatArray
    bodies: MeanBodies
    errors: FloatArray
    statures: FloatArray
    scale_sigma: float


def solve_scene(chosen: ChosenPhotos, model: BodyModel) -> SolvedScene:
    """Return the cameras and people of one moment; photos and people that do not fit are left out.

    Args:
        chosen: photos that share people.
        model: body model of the people, float64.

    Raises:
        InputError: no two photos fit each other.
    """
    photos_of_moved: list[str] = []
    while True:
        adjusted = _adjust(chosen)
        bad = adjusted.errors > _MOST_OFF
        view = _view_that_does_not_fit(bad, adjusted.errors)
        if view is not None and len(chosen.photos) == 2:
            raise InputError(
                f"no person of {chosen.photos[0].name} can be where {chosen.photos[1].name} shows "
                "one: give photos that were taken at the same moment, or of people who hold still, "
                "with a person in common"
            )
        if view is not None:
            why = "its people are in other places or poses than in the other photos"
            chosen = chosen.without(view, "does not fit", why)
            photos_of_moved = []
        elif bad.any() and len(chosen.rows) > 1:
            worst = int(np.argmax(bad.sum(0) + np.nanmax(adjusted.errors, axis=0)))
            photos_of_moved.append(
                ", ".join(chosen.photos[v].name for v in np.flatnonzero(chosen.rows[worst] >= 0))
            )
            chosen = replace(chosen, rows=np.delete(chosen.rows, worst, axis=0))
        else:
            return _solved_scene(chosen, photos_of_moved, adjusted, model)


@dataclass(frozen=True)
class _Adjustment:
    """Cameras and points of the people assumed to hold still, and the errors (V, P) of their
    keypoints.
    """

    reference: int
    observations: MomentObservations
    bundle: Bundle
    errors: FloatArray


def _solved_scene(
    chosen: ChosenPhotos, photos_of_moved: Sequence[str], adjustment: _Adjustment, model: BodyModel
) -> SolvedScene:
    """Return the solution at the scale of people's sizes, with one body for each person."""
    sigmas = camera_sigmas(adjustment.observations, adjustment.bundle, adjustment.reference)
    scale, scale_sigma = _scale_by_sizes(adjustment.observations, adjustment.bundle)
    bundle = adjustment.bundle.scaled(scale)
    photos = chosen.photos
    rows = chosen.rows
    people = [photo.people for photo in photos]
    observations = MomentObservations.of(people, rows)  # relative to the sizes in the single photos
    statures = sizes = known_statures(people, rows)
    if observations.camera_is_known.any():
        factor = sizes_by_cameras(observations, [bundle.pose(v) for v in range(len(photos))])
        mean_statures = [
            np.mean([people[v].stature[row[v]] for v in np.flatnonzero(row >= 0)]) for row in rows
        ]
        sizes = np.where(np.isfinite(statures), statures, factor * mean_statures)
    is_reference = np.arange(len(photos)) == adjustment.reference
    return SolvedScene(
        photos=photos,
        left_out=chosen.left_out,
        reference=adjustment.reference,
        rows=rows,
        photos_of_moved=tuple(photos_of_moved),
        observations=observations,
        bundle=bundle,
        intrinsics=tuple(
            _with_focal(
                photo.result.intrinsics, float(np.exp(bundle.log_focal[v])), float(sigmas[v, 2])
            )
            for v, photo in enumerate(photos)
        ),
        rotation_sigma=np.where(is_reference, 0.0, sigmas[:, 0]),
        position_sigma=np.where(is_reference, 0.0, sigmas[:, 1]),
        bodies=mean_bodies(people, rows, observations, bundle, model, sizes),
        errors=adjustment.errors,
        statures=statures,
        scale_sigma=scale_sigma,
    )


def _with_focal(camera: Intrinsics, factor: float, sigma: float) -> Intrinsics:
    """Return a camera with its focal length times a factor, and the error of its logarithm."""
    solved = replace(camera, fx=camera.fx * factor, fy=camera.fy * factor, focal_sigma=sigma)
    if camera.known:
        return solved
    return replace(solved, source="solved from several photos", trust=CameraTrust.ESTIMATED)


def _adjust(chosen: ChosenPhotos) -> _Adjustment:
    rows = chosen.rows
    people = [photo.people for photo in chosen.photos]
    reference = reference_photo(rows, people)
    poses = start_poses(chosen, reference)
    observations = _with_known_sizes(MomentObservations.of(people, rows), people, rows, poses)
    settings = KNOWN_CAMERAS if observations.camera_is_known.any() else SOLVED_CAMERAS
    bundle = adjust(observations, Bundle.start(observations, poses), reference, settings)
    return _Adjustment(reference, observations, bundle, keypoint_errors(observations, bundle))


def _scale_by_sizes(observations: MomentObservations, bundle: Bundle) -> tuple[float, float]:
    """Return the factor on all lengths by the sizes of people, and the standard deviation of its
    logarithm.

    Each person votes once, by known stature or by the mean size in the single photos: errors of one
    person's stature have common causes. These sizes include the evidence of each photo on its
    scale, such as soles on its floor. Distances in the photos follow from them and from focal
    lengths, whose errors are stated apart. Known cameras have a scale.
    """
    if observations.camera_is_known.any():
        return 1.0, 0.0
    size = np.log(_rms_size(observations.landmarks))
    log_size = np.nanmean(np.where(observations.is_visible, size, np.nan), axis=0)
    factor = np.exp(log_size) / _rms_size(bundle.points)
    known = np.isfinite(observations.bone_sigma)
    unknown = np.full(len(log_size), np.nan)
    voters = np.where(known, factor, np.nan) if known.any() else factor
    sigma = np.where(known, _KNOWN_BONE, stature_sigmas(unknown, unknown))
    vote = vote_on_scale(
        [Witnesses(voters, unknown, sigma, np.full(len(log_size), _SURE), shared_sigma=0.0)]
    )
    assert vote is not None
    assert vote.scale.sigma is not None
    return vote.scale.scale, vote.scale.sigma


def _rms_size(points: FloatArray) -> FloatArray:
    """Return the size (...) of people: the root mean square distance of their keypoints (..., J, 3)
    from the middle.
    """
    spread: FloatArray = np.linalg.norm(points - points.mean(axis=-2, keepdims=True), axis=(-2, -1))
    return spread


def keypoint_errors(observations: MomentObservations, bundle: Bundle) -> FloatArray:
    """Return the median distances (V, P) of solved keypoints from the photos', as a share of the
    stature in px.
    """
    errors = np.full(observations.is_visible.shape, np.nan)
    for v, p in zip(*np.nonzero(observations.is_visible), strict=True):
        local = bundle.pose(v).to_camera(bundle.points[p])
        uv, _, _ = project(local, observations.K[v], bundle.log_focal[v])
        away = np.linalg.norm(uv - observations.points[v, p], axis=1) / observations.size_px[v, p]
        is_seen = observations.confidence[v, p] >= _SEEN
        errors[v, p] = np.median(away[is_seen]) if is_seen.any() else np.nan
    return errors


def reference_photo(rows: IntArray, people: Sequence[PhotoPeople]) -> int:
    """Return the photo that shows most people of the scene, and of several the one that shows most
    of their bodies.

    Of photos of which some have known cameras, it is one of these.
    """
    shown = rows >= 0
    seen = [photo.confidence[rows[shown[:, v], v]].sum() for v, photo in enumerate(people)]
    known = [photo.pose is not None for photo in people]
    return max(range(len(people)), key=lambda v: (known[v], shown[:, v].sum(), seen[v]))


def _view_that_does_not_fit(bad: BoolArray, errors: FloatArray) -> int | None:
    """Return the worst photo of those in which most people do not fit; None if there is none."""
    shown = np.isfinite(errors)
    wrong = bad.sum(1) > 0.5 * np.maximum(shown.sum(1), 1)
    if not wrong.any():
        return None
    return int(np.argmax(np.where(wrong, np.nanmean(np.where(shown, errors, 0), axis=1), -1)))


def start_poses(chosen: ChosenPhotos, reference: int) -> list[CameraPose]:
    """Return poses of all cameras: known ones, and the others along the pairs of photos with the
    highest scores.
    """
    poses = {reference: CameraPose.identity()}
    base = chosen.photos[reference].people.pose
    for v, photo in enumerate(chosen.photos):
        if base is not None and photo.people.pose is not None:
            poses[v] = photo.people.pose.after(base.inverse())
    while len(poses) < len(chosen.photos):
        linked = (
            (a, b)
            for (a, b), match in chosen.matches.items()
            if match.pairs and (a in poses) != (b in poses)
        )
        a, b = max(
            linked, key=lambda pair: (chosen.matches[pair].score, len(chosen.matches[pair].pairs))
        )
        motion = chosen.matches[a, b].motion
        if a in poses:
            poses[b] = motion.after(poses[a])
        else:
            poses[a] = motion.inverse().after(poses[b])
    return [poses[v] for v in range(len(poses))]


def known_statures(people: Sequence[PhotoPeople], rows: IntArray) -> FloatArray:
    """Return the known stature of each person (P,), metres, NaN where unknown: the first that a
    photo states.
    """
    known = np.full(len(rows), np.nan)
    for v, photo in reversed(list(enumerate(people))):
        here = rows[:, v] >= 0
        own = photo.known_stature[rows[here, v]]
        known[here] = np.where(np.isfinite(own), own, known[here])
    return known


def _with_known_sizes(
    observations: MomentObservations,
    people: Sequence[PhotoPeople],
    rows: IntArray,
    poses: Sequence[CameraPose],
) -> MomentObservations:
    """Return the observations with the sizes of people by known cameras, or else those of people of
    known stature.
    """
    bone_m = observations.bone_m.copy()
    sigma = observations.bone_sigma.copy()
    landmarks = observations.landmarks.copy()
    if observations.camera_is_known.any():
        size = sizes_by_cameras(observations, poses)[:, None]
        return replace(observations, landmarks=landmarks * size[..., None], bone_m=bone_m * size)
    known = known_statures(people, rows)
    for p in np.flatnonzero(np.isfinite(known)).tolist():
        photos_of_person = np.flatnonzero(rows[p] >= 0)
        estimated = np.array([people[v].stature[rows[p, v]] for v in photos_of_person.tolist()])
        bone_m[p] *= known[p] / estimated.mean()
        landmarks[photos_of_person, p] *= (known[p] / estimated)[:, None, None]
        sigma[p] = _KNOWN_BONE
    return replace(observations, landmarks=landmarks, bone_m=bone_m, bone_sigma=sigma)
