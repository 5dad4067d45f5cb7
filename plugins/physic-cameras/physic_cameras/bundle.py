"""Bundle adjustment of all cameras: keypoints of matched people and matched pixels of the background.

Unknown are the poses of cameras and the logarithm of each focal length; the keypoints of people follow from them by
triangulation (variable projection), so that there are seven unknown numbers for each camera. Residuals, in units of
their expected sizes:

* keypoints: triangulated points against detections, through a Cauchy loss;
* background: first-order distances (Sampson) of matched pixels from their epipolar lines, through the same;
* focal lengths against those of the photos, and poses against those of a network, by their standard deviations.

The solution has no scale of its own: distances between cameras are held at those of the start, and
:func:`physic_cameras.solution.solved` multiplies all lengths by what the people's sizes tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import MaxLen, MinLen
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from physic_cameras.rig import NEAREST, CameraRig, triangulate
from physic_core.types.bounds import Positive, PositiveCount

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class BundleSettings:
    """Expected sizes of errors. Not chosen on photos.

    Attributes:
        keypoint: error of a keypoint of confidence 1, as a share of the stature in px.
        outlier: matches of the background beyond this many standard deviations do not take part.
        rounds: factors on ``outlier``, one after the other: focal lengths of the start can be wrong by a fifth.
        steps: most evaluations of the derivatives in each round.
    """

    keypoint: Positive = 0.02
    outlier: Positive = 3.0
    rounds: Annotated[tuple[Positive, ...], MinLen(1), MaxLen(8)] = (8.0, 3.0, 1.0)
    steps: PositiveCount = 50


@dataclass(frozen=True)
class Sightings:
    """n points, each in some of V photos.

    Attributes:
        rays: (V, n, 2) x / z and y / z.
        weight: (V, n) one over the error, in the same units; 0 where a photo does not see the point.
    """

    rays: FloatArray
    weight: FloatArray

    @classmethod
    def none(cls, views: int) -> Sightings:
        """Return sightings without points."""
        return cls(np.zeros((views, 0, 2)), np.zeros((views, 0)))


@dataclass(frozen=True)
class Matches:
    """m pixels of the background, each in two photos; some of them are wrong.

    Attributes:
        views: (m, 2) photos.
        rays: (m, 2, 2) x / z and y / z in both photos.
        sigma: (m,) error of the distance from an epipolar line, in the same units.
    """

    views: IntArray
    rays: FloatArray
    sigma: FloatArray

    @classmethod
    def none(cls) -> Matches:
        """Return no matches."""
        return cls(np.zeros((0, 2), np.int64), np.zeros((0, 2, 2)), np.zeros(0))

    def of(self, chosen: BoolArray) -> Matches:
        """Return some of the matches."""
        return Matches(self.views[chosen], self.rays[chosen], self.sigma[chosen])

    def errors(self, cameras: CalibratedRig) -> FloatArray:
        """Return first-order distances (m,) from epipolar lines, with signs, in standard deviations."""
        (one, two), rig = self.views.T, cameras.rig
        focal = np.exp(cameras.log_focal)[self.views]
        rays = self.rays / focal[..., None]
        turn = rig.rotation[two] @ rig.rotation[one].transpose(0, 2, 1)
        shift = rig.translation[two] - np.einsum("mij,mj->mi", turn, rig.translation[one])
        first, second = (np.concatenate([rays[:, side], np.ones((len(rays), 1))], axis=1) for side in range(2))
        line_two = np.cross(shift, np.einsum("mij,mj->mi", turn, first))
        line_one = np.einsum("mji,mj->mi", turn, np.cross(second, shift))
        slope = (line_two[:, :2] ** 2).sum(1) + (line_one[:, :2] ** 2).sum(1)
        distance: FloatArray = (second * line_two).sum(1) / np.sqrt(np.maximum(slope, 1e-18))
        errors: FloatArray = distance * focal.mean(1) / self.sigma
        return errors


@dataclass(frozen=True)
class CalibratedRig:
    """Poses and focal lengths of V cameras.

    Attributes:
        rig: poses.
        log_focal: (V,) logarithm of the factor on the focal length with which rays were made.
    """

    rig: CameraRig
    log_focal: FloatArray

    def points(self, sightings: Sightings) -> FloatArray:
        """Return the points (n, 3) that the cameras see, NaN where fewer than two do."""
        focal = np.exp(self.log_focal)[:, None]
        return triangulate(sightings.rays / focal[..., None], sightings.weight * focal, self.rig)


@dataclass(frozen=True)
class CameraPosePrior:
    """Estimated poses of the V cameras.

    Attributes:
        rig: the poses, at the scale of the start.
        rotation_sigma: standard deviation of a component of each rotation, radians.
        position_sigma: of a coordinate of each camera centre.
    """

    rig: CameraRig
    rotation_sigma: float
    position_sigma: float


@dataclass(frozen=True)
class BundleProblem:
    """What the cameras are adjusted to.

    Attributes:
        sightings: of people.
        matches: of the background.
        focal_sigma: (V,) of ``log_focal``.
        fixed: (V,) bool, cameras whose poses stay: the reference, and known ones.
        prior: poses that a network has estimated, None without such.
    """

    sightings: Sightings
    matches: Matches
    focal_sigma: FloatArray
    fixed: BoolArray
    prior: CameraPosePrior | None = None


@dataclass(frozen=True)
class Adjusted:
    """A solution with standard deviations, 0 for fixed cameras.

    Attributes:
        cameras: the solution.
        rotation_sigma: (V,) radians.
        position_sigma: (V,) of camera centres, in the lengths of the start.
        focal_sigma: (V,) of ``log_focal``.
    """

    cameras: CalibratedRig
    rotation_sigma: FloatArray
    position_sigma: FloatArray
    focal_sigma: FloatArray


def adjust(problem: BundleProblem, start: CalibratedRig, settings: BundleSettings) -> Adjusted:
    """Return the cameras with the least energy near a start."""
    cameras, count = start, 6 * int((~problem.fixed).sum()) + len(start.rig)
    for factor in settings.rounds:
        near = np.abs(problem.matches.errors(cameras)) < factor * settings.outlier
        chosen, before = replace(problem, matches=problem.matches.of(near)), cameras
        found = least_squares(
            lambda x, chosen=chosen, before=before: _residuals(chosen, start, _moved(before, x, problem.fixed)),
            np.zeros(count),
            x_scale="jac",
            max_nfev=settings.steps,
        )
        cameras = _moved(before, found.x, problem.fixed)
    covariance = np.linalg.pinv(found.jac.T @ found.jac, hermitian=True)
    free = np.flatnonzero(~problem.fixed)
    rotation, position = np.zeros(len(start.rig)), np.zeros(len(start.rig))
    variance = np.diag(covariance)
    pose = variance[: 6 * len(free)].reshape(-1, 2, 3).sum(-1)
    rotation[free], position[free] = np.sqrt(pose).T
    return Adjusted(cameras, rotation, position, np.sqrt(variance[6 * len(free) :]))


def _moved(cameras: CalibratedRig, x: FloatArray, fixed: BoolArray) -> CalibratedRig:
    """Return cameras after a step: turn and centre of each camera that is not fixed, then all focal lengths.

    Centres instead of translations: a turn of a camera then leaves it where it is.
    """
    free = np.flatnonzero(~fixed)
    step = x[: 6 * len(free)].reshape(-1, 6)
    rotation, centres = cameras.rig.rotation.copy(), cameras.rig.centres
    rotation[free] = Rotation.from_rotvec(step[:, :3]).as_matrix() @ rotation[free]
    centres[free] += step[:, 3:]
    rig = CameraRig(rotation, -np.einsum("vij,vj->vi", rotation, centres))
    return CalibratedRig(rig, cameras.log_focal + x[6 * len(free) :])


def _residuals(problem: BundleProblem, start: CalibratedRig, cameras: CalibratedRig) -> FloatArray:
    """Return all residuals (m,), in units of their expected sizes."""
    rig, seen = cameras.rig, problem.sightings
    local = rig.to_cameras(cameras.points(seen))
    focal = np.exp(cameras.log_focal)[:, None, None]
    away = focal * local[..., :2] / np.maximum(local[..., 2:], NEAREST) - seen.rays
    parts = [
        _cauchy((away * seen.weight[..., None])[seen.weight > 0]),
        _cauchy(problem.matches.errors(cameras)),
        cameras.log_focal / problem.focal_sigma,
    ]
    free = ~problem.fixed
    if (prior := problem.prior) is not None:
        turn = rig.rotation @ prior.rig.rotation.transpose(0, 2, 1)
        parts += [
            Rotation.from_matrix(turn[free]).as_rotvec() / prior.rotation_sigma,
            (rig.centres - prior.rig.centres)[free] / prior.position_sigma,
        ]
    if problem.fixed.sum() < 2:  # two fixed cameras have a scale
        parts.append(np.array([np.log(_extent(rig) / _extent(start.rig))]))
    return np.concatenate([part.ravel() for part in parts])


def _cauchy(errors: FloatArray) -> FloatArray:
    """Return numbers whose squares are the Cauchy loss of errors."""
    loss: FloatArray = np.sign(errors) * np.sqrt(np.log1p(errors**2))
    return loss


def _extent(rig: CameraRig) -> float:
    """Return the mean distance of the cameras from their middle."""
    return float(np.linalg.norm(rig.centres - rig.centres.mean(0), axis=1).mean())
