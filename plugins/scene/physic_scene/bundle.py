"""Cameras of several photos by a bundle adjustment whose points are the keypoints of matched
people.

Unknown are the pose of each camera but the reference's, the logarithm of each focal length, and the
place of each person's keypoints in the reference frame. Residuals, in units of their expected
sizes, through a Cauchy loss:

* keypoints: projected points against detections;
* bodies: points against the landmarks of each photo's body, up to that body's place and, weakly,
  its turn; errors along the line of sight are larger;
* bones: lengths between points against those of the bodies;
* floors: their normals against each other;
* focal lengths against those of the photos, which share a part of their error.

The sizes are those of ``measured_errors.json``. The mean length of all bones gives the scale, after
the adjustment: points are means of bodies with different errors of rotation, which makes them too
small. Solved by Levenberg-Marquardt steps on sparse normal equations.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from physic_core.types import SIDES
from physic_scene.measured_errors import keypoint_class, measured_errors
from physic_scene.rigid import CameraPose

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, IntArray
    from physic_scene.observations import PhotoPeople

_NEAREST_M = 0.1
_FIXED = 1e-6  # standard deviation of a parameter that stays
_KNOWN_FOCAL = 0.01  # standard deviation of the logarithm of a known focal length
_ROTATION_STATED = 1.33
_POSITION_STATED = 0.71
"""Factors on the standard deviations that follow from the curvature of the energy, which does not
know that bodies of one photo err alike. They make them those of 26 pairs of photos of a rig; on the
pairs that took no part, errors of rotations then are 1.1 and 1.2 of them, those of camera centres
1.1 and 1.0.
"""
_BONES = (
    ("shoulder", "elbow"),
    ("elbow", "wrist"),
    ("hip", "knee"),
    ("knee", "ankle"),
    ("shoulder", "hip"),
)


@dataclass(frozen=True)
class BundleSettings:
    """Settings of the bundle adjustment; the other expected sizes are those of
    ``measured_errors.json``.

    Attributes:
        keypoint: factor on the measured errors of keypoints.
        outlier: beyond this many expected sizes, a residual counts as an outlier. 0.7 gives the
            least errors of directions on twelve worlds, and stated uncertainties that match them;
            1.0 and 1.5 have larger errors.
        steps: most steps at each of ``rounds``.
        rounds: factors on ``outlier``, one after the other, so that a rough start can converge.
    """

    keypoint: float = 1.0
    outlier: float = 0.7
    steps: int = 25
    rounds: tuple[float, ...] = (8.0, 3.0, 1.0)


SOLVED_CAMERAS = BundleSettings()
KNOWN_CAMERAS = BundleSettings(keypoint=0.25, outlier=3.0)
"""Settings for the points of known cameras.

The errors measured on worlds are those of people to whom cameras are fitted. With ``keypoint`` 1,
points of four photos follow the bodies, although the keypoints are more accurate. On two moments of
a rig, 0.25 and 0.15 with 3 sigmas reproject best into a photo that is left out.
"""


@dataclass(frozen=True)
class MomentObservations:
    """Observations of P people with J keypoints in V photos.

    Attributes:
        K: (V, 3, 3) px.
        focal_sigma: (V,).
        names: of the J keypoints.
        points: (V, P, J, 2) px.
        confidence: (V, P, J); 0 where a photo does not show the person or the keypoint.
        landmarks: (V, P, J, 3) metres, camera frames.
        is_visible: (V, P) bool, whether a photo shows the person.
        size_px: (V, P) stature in px.
        limb: (J,) number of the arm or leg of each keypoint, 0 for trunk and head.
        bones: (B, 2) keypoints at the ends of each bone.
        bone_m: (P, B) lengths.
        bone_sigma: (P,) error of their logarithm; NaN for that of the settings.
        up: (V, 3) normal of the floor in each photo, NaN without a floor.
        camera_is_known: (V,) bool, cameras whose motions between each other are known; at least
            two, or none.
    """

    K: FloatArray
    focal_sigma: FloatArray
    names: tuple[str, ...]
    points: FloatArray
    confidence: FloatArray
    landmarks: FloatArray
    is_visible: BoolArray
    size_px: FloatArray
    limb: IntArray
    bones: IntArray
    bone_m: FloatArray
    bone_sigma: FloatArray
    up: FloatArray
    camera_is_known: BoolArray

    @classmethod
    def of(cls, people: Sequence[PhotoPeople], rows: IntArray) -> MomentObservations:
        """Collect the observations of matched people.

        Args:
            people: of each photo.
            rows: (P, V) row of each person in each photo, -1 where not shown.
        """
        shown = rows.T >= 0

        def gather(name: str) -> FloatArray:
            return np.stack(
                [
                    np.asarray(getattr(photo, name))[np.maximum(rows[:, v], 0)]
                    for v, photo in enumerate(people)
                ]
            )

        known = np.array([photo.pose is not None for photo in people])
        names = people[0].skeleton.names
        bones = bones_of(names)
        landmarks = gather("landmarks")
        length = np.linalg.norm(
            landmarks[:, :, bones[:, 0]] - landmarks[:, :, bones[:, 1]], axis=-1
        )
        mean = np.exp(np.nanmean(np.where(shown[..., None], np.log(length), np.nan), axis=0))
        return cls(
            K=np.stack([photo.K for photo in people]),
            focal_sigma=np.array([photo.focal_sigma for photo in people]),
            names=tuple(names),
            points=gather("points"),
            confidence=gather("confidence") * shown[..., None],
            landmarks=landmarks,
            is_visible=shown,
            size_px=gather("size_px"),
            limb=np.array([_limb_number(name) for name in names]),
            bones=bones,
            bone_m=mean,
            bone_sigma=np.full(len(mean), np.nan),
            up=np.stack([photo.up for photo in people]),
            camera_is_known=known & (known.sum() > 1),
        )


@dataclass(frozen=True)
class Columns:
    """Columns of the Jacobian, in the order of the parameters of a step.

    Attributes:
        camera: (V, 6) turn and translation of each camera.
        focal: (V,) its logarithm of the focal length.
        points: (P, J, 3) points of each person.
        turn: (V, P, 3) turn of each photo's body.
        position: (V, P, 3) place of each photo's body.
        count: of all.
    """

    camera: IntArray
    focal: IntArray
    points: IntArray
    turn: IntArray
    position: IntArray
    count: int

    @classmethod
    def of(cls, views: int, people: int, joints: int) -> Columns:
        """Return the columns of V cameras and P people with J keypoints."""
        body = (views, people, 3)
        shapes = ((views, 6), (views,), (people, joints, 3), body, body)
        *ends, count = np.cumsum([np.prod(shape) for shape in shapes]).tolist()
        parts = np.split(np.arange(count), ends)
        camera, focal, points, turn, position = (
            part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)
        )
        return cls(camera, focal, points, turn, position, count)


@dataclass(frozen=True)
class Bundle:
    """Cameras and points.

    Attributes:
        rotation: (V, 3, 3) of :class:`CameraPose`, identity for the reference.
        translation: (V, 3) metres.
        log_focal: (V,) logarithm of the factor on each focal length.
        points: (P, J, 3) metres, reference frame.
        turn: (V, P, 3, 3) correction of the turn of each photo's body, in the frame of its camera.
        position: (V, P, 3) metres, correction of its place.
    """

    rotation: FloatArray
    translation: FloatArray
    log_focal: FloatArray
    points: FloatArray
    turn: FloatArray
    position: FloatArray

    @classmethod
    def start(cls, observations: MomentObservations, poses: Sequence[CameraPose]) -> Bundle:
        """Return a start from poses of the cameras: points are the mean of the photos'
        landmarks.
        """
        shown = observations.is_visible
        common = np.stack(
            [pose.to_common(observations.landmarks[v]) for v, pose in enumerate(poses)]
        )
        weight = shown[..., None, None] * np.maximum(observations.confidence, 0.02)[..., None]
        return cls(
            rotation=np.stack([pose.rotation for pose in poses]),
            translation=np.stack([pose.translation for pose in poses]),
            log_focal=np.zeros(len(poses)),
            points=(weight * common).sum(0) / np.maximum(weight.sum(0), 1e-9),
            turn=np.broadcast_to(np.eye(3), (*shown.shape, 3, 3)),
            position=np.zeros((*shown.shape, 3)),
        )

    @cached_property
    def columns(self) -> Columns:
        """Columns of the parameters."""
        people, joints, _ = self.points.shape
        return Columns.of(len(self.rotation), people, joints)

    def pose(self, view: int) -> CameraPose:
        """Return the pose of a camera."""
        return CameraPose(self.rotation[view], self.translation[view])

    def scaled(self, factor: float) -> Bundle:
        """Return a copy with all lengths multiplied; the bodies' places are corrections of the
        start, and stay.
        """
        return replace(self, translation=factor * self.translation, points=factor * self.points)

    def moved(self, step: FloatArray) -> Bundle:
        """Return a copy after a step of all parameters."""
        at = self.columns
        camera = step[at.camera]
        return Bundle(
            _rotations(camera[:, :3]) @ self.rotation,
            self.translation + camera[:, 3:],
            self.log_focal + step[at.focal],
            self.points + step[at.points],
            _rotations(step[at.turn]) @ self.turn,
            self.position + step[at.position],
        )


@dataclass(frozen=True)
class ResidualBlock:
    """Residuals (m, d) with their derivatives (m, d, k) by the parameters of columns (m, k).

    Residuals with the same number in ``group`` (m,) are outliers together, by their mean square;
    with None, each is separate.
    """

    residual: FloatArray
    jacobian: FloatArray
    columns: IntArray
    is_robust: bool = True
    group: IntArray | None = None


def bones_of(names: Sequence[str]) -> IntArray:
    """Return the keypoints (B, 2) at the ends of the bones of a skeleton's arms, legs and trunk."""
    ends = [(f"{side}_{a}", f"{side}_{b}") for side in SIDES for a, b in _BONES]
    return np.array(
        [(names.index(a), names.index(b)) for a, b in ends if a in names and b in names]
    )


def adjust(
    observations: MomentObservations,
    start: Bundle,
    reference: int,
    settings: BundleSettings = SOLVED_CAMERAS,
) -> Bundle:
    """Return the cameras and points with the least energy near a start.

    Args:
        observations: of all photos.
        start: cameras and points.
        reference: index of the camera whose pose stays.
        settings: of the energy.
    """
    state = start
    for factor in settings.rounds:
        wide = replace(settings, outlier=settings.outlier * factor)
        damping = 1e-3
        normal, gradient, energy = _normal_equations(observations, state, reference, wide)
        for _ in range(settings.steps):
            step = -splu(csc_array(normal + diags_array(damping * normal.diagonal()))).solve(
                gradient
            )
            trial = state.moved(step)
            equations = _normal_equations(observations, trial, reference, wide)
            if equations[2] >= energy:
                damping *= 8
                if damping > 1e6:
                    break
                continue
            gain = energy - equations[2]
            state, (normal, gradient, energy), damping = trial, equations, max(damping / 4, 1e-9)
            if gain < 1e-5 * energy:
                break
    return state


def energy(
    observations: MomentObservations,
    state: Bundle,
    reference: int,
    settings: BundleSettings = SOLVED_CAMERAS,
) -> float:
    """Return the energy of cameras and points: twice the negative logarithm of their likelihood, up
    to a constant.
    """
    return _normal_equations(observations, state, reference, settings)[2]


def camera_sigmas(observations: MomentObservations, state: Bundle, reference: int) -> FloatArray:
    """Return the standard deviations (V, 3) of each camera, from the curvature of the energy and
    the factors on them.

    They are those of the rotation relative to the reference, radians, of the camera centre, metres,
    and of the logarithm of the focal length.
    """
    normal, _, _ = _normal_equations(observations, state, reference, SOLVED_CAMERAS)
    views = len(state.rotation)
    covariance = splu(csc_array(normal)).solve(np.eye(normal.shape[0], 7 * views))
    variances = np.empty((views, 3))
    for v, (camera, focal) in enumerate(
        zip(state.columns.camera, state.columns.focal, strict=True)
    ):
        camera_covariance = covariance[np.ix_(camera, camera)]
        # The centre is -R^T t: a rotation by w turns it by R^T (t x w).
        moves = np.hstack(
            [state.rotation[v].T @ _cross(state.translation[v]), -state.rotation[v].T]
        )
        center_variance = max(np.trace(moves @ camera_covariance @ moves.T), 0.0)
        variances[v] = (
            np.trace(camera_covariance[:3, :3]),
            center_variance,
            covariance[focal, focal],
        )
    return np.sqrt(variances) * [_ROTATION_STATED, _POSITION_STATED, 1.0]


def _normal_equations(
    observations: MomentObservations, state: Bundle, reference: int, settings: BundleSettings
) -> tuple[csc_array, FloatArray, float]:
    """Return normal matrix, gradient and energy, with Cauchy weights."""
    energy = 0.0
    first = 0
    values = []
    rows = []
    columns = []
    residuals = []
    for block in _blocks(observations, state, reference, settings):
        weight, block_energy = robust_weights(block, settings.outlier)
        energy += block_energy
        m, d, k = block.jacobian.shape
        root = np.sqrt(weight)[:, None]
        values.append((root[..., None] * block.jacobian).reshape(-1))
        rows.append(first + np.repeat(np.arange(m * d), k))
        columns.append(np.repeat(block.columns[:, None], d, axis=1).reshape(-1))
        residuals.append((root * block.residual).reshape(-1))
        first += m * d
    indices = np.concatenate(rows), np.concatenate(columns)
    jacobian = csr_array(coo_array((np.concatenate(values), indices), (first, state.columns.count)))
    return csc_array(jacobian.T @ jacobian), jacobian.T @ np.concatenate(residuals), energy


def _blocks(
    observations: MomentObservations, state: Bundle, reference: int, settings: BundleSettings
) -> list[ResidualBlock]:
    at = state.columns
    known = np.flatnonzero(observations.camera_is_known).tolist()
    return [
        # The frame is that of the reference camera, which is a known one if there are any.
        *(_prior_block(np.zeros(6), at.camera[v], _FIXED) for v in {reference, *known}),
        *(_prior_block(np.zeros(1), at.focal[[v]], _FIXED) for v in known),
        _focal_block(state, observations.focal_sigma),
        # The place of a body is free; where a photo does not show the person, place and turn are
        # without meaning.
        _prior_block(state.position.reshape(-1), at.position.reshape(-1), 1e4),
        _prior_block(np.zeros(state.position.size), at.turn.reshape(-1), 1e4),
        *itertools.chain.from_iterable(
            _person_blocks(observations, state, v, p, settings)
            for v, p in zip(*np.nonzero(observations.is_visible), strict=True)
        ),
        _bone_block(observations, state),
        *_floor_blocks(observations, state),
    ]


def _person_blocks(
    observations: MomentObservations, state: Bundle, v: int, p: int, settings: BundleSettings
) -> Iterator[ResidualBlock]:
    """Yield the residuals of the keypoints of person ``p`` in photo ``v``, of the body there, and
    of its turn.
    """
    yield _keypoint_block(observations, state, v, p, settings)
    yield _landmark_block(observations, state, v, p)
    about, tilt = 1 / np.radians(measured_errors().turn_deg)
    middle = observations.landmarks[v, p].mean(axis=0)
    turning = _along_and_across(middle, np.array([about]), np.array([tilt]))
    vector = Rotation.from_matrix(state.turn[v, p]).as_rotvec()
    turn = state.columns.turn[v, p]
    yield ResidualBlock((turning[0] @ vector)[None], turning, turn[None], is_robust=False)


def _in_camera(state: Bundle, v: int, p: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the points (J, 3) of person ``p`` in the frame of camera ``v``, their derivatives
    (J, 3, 9) by the camera (6) and the points (3), and the columns (J, 9) of these.
    """
    joints = state.points.shape[1]
    each = np.broadcast_to(np.eye(3), (joints, 3, 3))
    turned = state.points[p] @ state.rotation[v].T
    moves = np.concatenate(
        [-_cross(turned), each, np.broadcast_to(state.rotation[v], (joints, 3, 3))], axis=2
    )
    camera = np.broadcast_to(state.columns.camera[v], (joints, 6))
    columns = np.concatenate([camera, state.columns.points[p]], axis=1)
    return turned + state.translation[v], moves, columns


def _keypoint_block(
    observations: MomentObservations, state: Bundle, v: int, p: int, settings: BundleSettings
) -> ResidualBlock:
    """Return the residuals of the keypoints of a person in a photo."""
    local, moves, columns = _in_camera(state, v, p)
    share, _ = _errors_of(observations.names)
    uv, by_local, by_focal = project(local, observations.K[v], state.log_focal[v])
    confidence = observations.confidence[v, p]
    sigma = measured_errors().keypoint_sigma(confidence)
    unit = settings.keypoint * sigma * observations.size_px[v, p]
    weight = np.sqrt(share) * (confidence > 0) / unit
    weighted = weight > 0
    focal = np.full((len(local), 1), state.columns.focal[v])
    jacobian = weight[:, None, None] * np.concatenate(
        [by_local @ moves, by_focal[..., None]], axis=2
    )
    residual = weight[:, None] * (uv - observations.points[v, p])
    columns = np.concatenate([columns, focal], axis=1)
    return ResidualBlock(
        residual[weighted], jacobian[weighted], columns[weighted], group=observations.limb[weighted]
    )


def _landmark_block(
    observations: MomentObservations, state: Bundle, v: int, p: int
) -> ResidualBlock:
    """Return the residuals of the body of a person in a photo."""
    local, moves, columns = _in_camera(state, v, p)
    _, landmark_m = _errors_of(observations.names)
    middle = observations.landmarks[v, p].mean(axis=0)
    body = (observations.landmarks[v, p] - middle) @ state.turn[v, p].T
    at = state.columns
    own = np.broadcast_to(np.concatenate([at.turn[v, p], at.position[v, p]]), (len(local), 6))
    scaled = _along_and_across(middle, *(1 / landmark_m).T)
    residual = np.einsum("jab,jb->ja", scaled, local - body - middle - state.position[v, p])
    each = np.broadcast_to(np.eye(3), (len(local), 3, 3))
    jacobian = scaled @ np.concatenate([moves, _cross(body), -each], axis=2)
    return ResidualBlock(
        residual, jacobian, np.concatenate([columns, own], axis=1), group=observations.limb
    )


@cache
def _errors_of(names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    return measured_errors().of(names)


def robust_weights(block: ResidualBlock, outlier: float) -> tuple[FloatArray, float]:
    """Return the Cauchy weights (m,) of residuals that are outliers beyond a size, and their
    energy.
    """
    square = (block.residual**2).sum(1)
    if not block.is_robust:
        return np.ones(len(square)), float(square.sum())
    if block.group is not None:
        total, count = (np.bincount(block.group, weights) for weights in (square, None))
        square = (total / np.maximum(count, 1))[block.group]
    share = square / outlier**2
    return 1 / (1 + share), float(outlier**2 * np.log1p(share).sum())


def _along_and_across(point: FloatArray, along: FloatArray, across: FloatArray) -> FloatArray:
    """Return matrices (n, 3, 3) that scale vectors along the line of sight to a point (3,), and
    across it.
    """
    ray = point / np.linalg.norm(point)
    line = np.outer(ray, ray)
    scaled: FloatArray = along[:, None, None] * line + across[:, None, None] * (np.eye(3) - line)
    return scaled


def _focal_block(state: Bundle, sigma: FloatArray) -> ResidualBlock:
    """Return the residuals of the logarithms of focal lengths (V,), which share a part of their
    error.
    """
    common, own = np.square(measured_errors().focal)
    share = common / (common + own)
    covariance = (1 - share) * np.diag(sigma**2) + share * np.outer(sigma, sigma)
    # Known cameras have errors of their own.
    known = sigma < _KNOWN_FOCAL
    covariance[known] = 0
    covariance[:, known] = 0
    covariance[known, known] = sigma[known] ** 2
    white = np.linalg.inv(np.linalg.cholesky(covariance))
    residual = (white @ state.log_focal)[None]
    return ResidualBlock(residual, white[None], state.columns.focal[None], is_robust=False)


def _limb_number(name: str) -> int:
    """Return the number of a keypoint's arm or leg, 0 for trunk and head."""
    side = name.partition("_")[0]
    kind = keypoint_class(name)
    if side not in SIDES or kind == "head":
        return 0
    return 1 + SIDES.index(side) + 2 * (kind in ("hip", "knee", "foot"))


def _prior_block(values: FloatArray, columns: IntArray, sigma: float) -> ResidualBlock:
    """Return the residuals of parameters (n,) from 0."""
    slope = np.full((len(values), 1, 1), 1 / sigma)
    return ResidualBlock(values[:, None] * slope[..., 0], slope, columns[:, None], is_robust=False)


def _bone_block(observations: MomentObservations, state: Bundle) -> ResidualBlock:
    """Return the residuals of bone lengths."""
    a, b = observations.bones.T
    along = state.points[:, b] - state.points[:, a]
    length = np.maximum(np.linalg.norm(along, axis=-1), 1e-3)
    own = observations.bone_sigma
    sigma = np.where(np.isnan(own), measured_errors().bone, own)[:, None]
    residual = np.log(length / observations.bone_m) / sigma
    slope = along / length[..., None] ** 2 / sigma[..., None]
    points = state.columns.points
    columns = np.concatenate([points[:, a], points[:, b]], axis=-1)
    jacobian = np.concatenate([-slope, slope], axis=-1)
    return ResidualBlock(
        residual.reshape(-1, 1), jacobian.reshape(-1, 1, 6), columns.reshape(-1, 6)
    )


def _floor_blocks(observations: MomentObservations, state: Bundle) -> list[ResidualBlock]:
    """Return the residuals of the floors' normals of each two photos."""
    known = np.flatnonzero(np.isfinite(observations.up).all(1))
    # Each of n floors is in n - 1 of the pairs, and a pair has the errors of both: together they
    # count as n floors.
    unit = np.radians(measured_errors().floor_deg) * np.sqrt(max(len(known), 1))
    blocks = []
    for a, b in itertools.combinations(known, 2):
        motion = state.rotation[b] @ state.rotation[a].T
        turned = motion @ observations.up[a]
        jacobian = np.hstack([motion @ _cross(observations.up[a]), -_cross(turned)]) / unit
        columns = state.columns.camera[[a, b], :3].reshape(-1)
        blocks.append(
            ResidualBlock((turned - observations.up[b])[None] / unit, jacobian[None], columns[None])
        )
    return blocks


def project(
    local: FloatArray, K: FloatArray, log_focal: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pixels (n, 2) of points (n, 3), and their derivatives (n, 2, 3) and (n, 2) by point
    and log focal.
    """
    z = np.maximum(local[:, 2], _NEAREST_M)
    focal = np.exp(log_focal) * np.array([K[0, 0], K[1, 1]])
    from_centre = focal * local[:, :2] / z[:, None]
    slope = np.zeros((len(local), 2, 3))
    slope[:, 0, 0] = focal[0] / z
    slope[:, 1, 1] = focal[1] / z
    slope[:, :, 2] = -from_centre / z[:, None]
    return from_centre + K[:2, 2], slope, from_centre


def _rotations(rotvecs: FloatArray) -> FloatArray:
    """Return the rotations (..., 3, 3) of rotation vectors (..., 3)."""
    turns: FloatArray = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix()
    return turns.reshape(*rotvecs.shape, 3)


def _cross(vectors: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of the cross products with vectors (..., 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack(
        [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)],
        axis=-2,
    )
