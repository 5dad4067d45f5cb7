"""Fit bodies to all people of a photo: keypoints and 3D landmarks, then the vertical, then the
outlines of masks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from physic_core.backends.devices import limited_threads
from physic_core.body import JOINT_NAMES, joint_pair, parameters_from_rotations, standing_legs
from physic_core.engine.ground.posture import is_surely_standing, is_upright, trunk_image_angle_deg
from physic_core.geometry import rotmat_to_rotvec
from physic_core.types import LEAST_PROBABILITY, POSTURES, SURE_CONFIDENCE, Bodies, Observations
from physic_embedded.body_fit.fit import fit_bodies, fit_outlines, lifted_limbs
from physic_embedded.body_fit.fit_problem import (
    KNEE_SIGMA,
    UPRIGHT_SIGMA,
    FloorConstraint,
    InitialPose,
)
from physic_embedded.body_fit.hidden_legs import (
    has_hidden_legs,
    pitch_sigma,
    with_hidden_legs,
    without_guessed_legs,
)
from physic_embedded.body_fit.initial_pose import initial_translation, pose_from_landmarks
from physic_embedded.body_fit.joint_sigma import joint_sigma, limb_evidence
from physic_embedded.body_fit.lean import lean_towards_camera
from physic_embedded.body_fit.limb_keypoints import limb_keypoints, sided_indices
from physic_embedded.body_fit.minimise import covariance
from physic_embedded.body_fit.multi_start import fit_without_world_landmarks
from physic_embedded.body_fit.observations import observe_people
from physic_embedded.body_fit.posture_legs import (
    legs_by_posture,
    legs_of_other_postures,
    with_legs,
    without_posture,
)
from physic_embedded.body_fit.silhouette import outline_pairs, without_legs
from physic_networks.bodies import observed_joints

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, FloatArray, Hints, Intrinsics, Keypoints, People
    from physic_embedded.body_fit.fit import FittedBodies
    from physic_embedded.body_fit.observations import BodyObservations

    Earlier = tuple[FittedBodies, BoolArray] | None

_UP_OF_LEVEL_CAMERA = np.array([0.0, -1.0, 0.0])
_MAX_APPARENT_BEND = 0.7  # radians by which a knee of an upright person may seem bent
_BEND_SHARE = 0.35  # share of it that counts as real
# Of the fit's squared residuals: more than a posture of the legs may cost; the cost of uprightness
# that halves its weight, and what it may cost for nothing.
_ACCEPTED_RISE = 50.0
_HALVING_RISE = 75.0
_FREE_RISE = 25.0
_MAX_LEAN = 0.44  # radians; a larger lean is a misread floor or no stance
_ACROSS_DEG = 60.0  # from up in the picture, of a trunk that is not compared with the vertical

_ROTATION_SIGMA = {
    "pelvis": 0.39,
    "spine": 0.10,
    "hip": 0.47,
    "knee": 0.62,
    "shoulder": 0.70,
    "elbow": 0.84,
}
"""Standard deviations, radians, of rotations fitted to world landmarks; other joints have no known
truth.

Measured against true joints: the pelvis on four photos of mpi_inf_3dhp, the others on 15 frames of
parkour, of the films for fits. There the errors about two of three axes are 8 degrees for the
spine, which has three joints, 22 for hips, 29 for knees, 33 for shoulders and 39 for elbows.
"""


def fit_people(
    model: BodyModel, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
) -> Bodies:
    """Fit one body to each of N people; arguments and result as in
    :meth:`physic_embedded.body_estimator.EmbeddedBodies.infer`.

    Args:
        model: body model, float64.
        people: their masks and boxes.
        intrinsics: of the photo.
        keypoints: of the people.
        hints: observations, floor, up, and the point map of the photo.
    """
    keypoints = limb_keypoints(keypoints)
    observed = observed_joints(keypoints, intrinsics.height, intrinsics.width, finger_share=0)
    if not len(people):
        rotations, betas, transl = model.zero_pose(0)
        return Bodies(
            parameters_from_rotations(rotations, betas, None, transl), "embedded", observed
        )
    skeleton = keypoints.joint_set
    person_observations = hints.observations or Observations.unknown(len(people))
    known = _known_up(hints)
    up = _UP_OF_LEVEL_CAMERA if known is None else known
    observations = with_hidden_legs(
        observe_people(keypoints, people, intrinsics, person_observations),
        skeleton,
        person_observations,
        up,
    )
    legs_hidden = has_hidden_legs(observations, skeleton)
    with torch.enable_grad(), limited_threads():
        fit = _fit_keypoints(model, observations)
        fit, upright = _refit_upright(
            model, fit, observations, keypoints, person_observations, known
        )
        lean_sigma = UPRIGHT_SIGMA / np.sqrt(np.where(upright > 0, upright, np.nan))
        pairs = outline_pairs(model, fit, observations, people, hints.original)
        lifted = None
        if observations.world is not None and keypoints.depth_sigma is None:
            lifted = lifted_limbs(fit, observations, known, legs_hidden)
        fit = fit_outlines(model, fit, without_legs(model, pairs, legs_hidden), lifted)
        rotation_sigma = _rotation_sigma(fit, observations, upright)
    return Bodies(
        parameters_from_rotations(fit.rotations, fit.betas, None, fit.transl),
        "embedded",
        observed,
        rotation_sigma=rotation_sigma,
        lean_sigma=np.where(
            legs_hidden & ~(upright > 0), pitch_sigma(person_observations), lean_sigma
        ),
        joint_sigma=None
        if lifted is None
        else joint_sigma(limb_evidence(observations, lifted.distance.numpy())),
    )


def _known_up(hints: Hints) -> FloatArray | None:
    """Return up, else the floor's normal; None if neither is known."""
    return hints.floor.normal if hints.up is None and hints.floor is not None else hints.up


def _fit_keypoints(model: BodyModel, observations: BodyObservations) -> FittedBodies:
    """Fit bodies to keypoints and 3D landmarks, starting from the pose of the landmarks, or from
    several poses without any.
    """
    if observations.world is None:
        return fit_without_world_landmarks(model, observations)
    roots = []
    poses = []
    translations = []
    for i, landmarks in enumerate(observations.world):
        turned = landmarks @ observations.turn[i].T
        root, pose = pose_from_landmarks(turned, observations.skeleton)
        roots.append(root)
        poses.append(pose)
        translations.append(initial_translation(turned, observations, i))
    return fit_bodies(
        model,
        observations,
        InitialPose(np.array(roots), np.array(poses), np.array(translations)),
    )


def _has_comparable_trunk(
    keypoints: Keypoints, person_observations: Observations, legs_hidden: BoolArray, is_known: bool
) -> BoolArray:
    """Return whose trunk (N,) is compared with the vertical, which is known or not: not that of
    people across the picture.
    """
    lies = person_observations.posture[:, POSTURES.index("lie")] > LEAST_PROBABILITY
    across = np.abs(trunk_image_angle_deg(keypoints))
    return ((legs_hidden & ~lies) | is_known) & ~(across > _ACROSS_DEG)


def _refit_upright(
    model: BodyModel,
    fit: FittedBodies,
    observations: BodyObservations,
    keypoints: Keypoints,
    person_observations: Observations,
    known: FloatArray | None,
) -> tuple[FittedBodies, FloatArray]:
    """Repeat the fit with the vertical (3,), or that of a level camera if none is known: feet
    level, legs as the posture says, and standing people upright. These have visible straight legs,
    or stand by picture and observer.

    Return the fit, and the share (N,) of uprightness of each person, less where it makes the fit
    worse. A fit whose detector states errors of depth stays as it is.

    The landmarks are turned back by the lean before the fit. Turning the finished body instead
    would not do: its keypoints move, and the next optimisation turns it back.
    """
    legs_hidden = has_hidden_legs(observations, observations.skeleton)
    trunk = _has_comparable_trunk(keypoints, person_observations, legs_hidden, known is not None)
    if not trunk.any() or observations.depth_sigma is not None:
        return fit, np.zeros(len(trunk))
    up = np.asarray(_UP_OF_LEVEL_CAMERA if known is None else known, np.float64)
    joints = fit.joints.double().numpy()
    stands = _has_straight_legs(joints, observations) | _surely_stands(
        keypoints, person_observations
    )
    upright, turn = _correctable_lean(joints, observations, up, legs_hidden, stands & trunk)
    legs = without_posture(legs_by_posture(person_observations), ~trunk)
    posed = legs_of_other_postures(joints, observations, up, legs)

    def refit(
        share: FloatArray, pitch: FloatArray, earlier_fits: Earlier = None, continues: bool = False
    ) -> FittedBodies:
        return fit_bodies(
            model,
            without_guessed_legs(
                observations, observations.skeleton, person_observations, up, posed
            ),
            with_legs(
                _initial_poses_from_fit(fit, observations, turn, upright), joints, posed, up, legs
            ),
            floor=FloorConstraint(up, trunk, share, pitch, legs),
            earlier_fits=earlier_fits,
            continues=continues,
        )

    share: FloatArray = upright.astype(np.float64)
    refitted = refit(share, turn)
    unlike = posed.any(1) & (refitted.loss - fit.loss > _ACCEPTED_RISE)
    if unlike.any():
        legs = without_posture(legs, unlike)
        posed &= ~unlike[:, None]
        refitted = refit(share, turn, (refitted, unlike))
    share, costly = _upright_share(upright, refitted.loss - fit.loss)
    if costly.any():
        refitted = refit(share, share * turn, (refitted, costly), continues=True)
    return refitted, share


def _upright_share(upright: BoolArray, rise: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the share of uprightness (N,) by the rise of the loss (N,), and for whom it is less
    than whole (N,).
    """
    costly = np.asarray(upright & (rise > _FREE_RISE))
    less = 1 / (1 + (np.maximum(rise, 0) / _HALVING_RISE) ** 4)
    return np.where(costly, less, upright), costly


def _correctable_lean(
    joints: FloatArray,
    observations: BodyObservations,
    up: FloatArray,
    legs_hidden: BoolArray,
    stands: BoolArray,
) -> tuple[BoolArray, FloatArray]:
    """Return who of those who stand (N,) does not lean too far to be set upright, and the turn
    (N,), radians, that sets them upright.
    """
    lean = lean_towards_camera(joints, observations.turn, up, legs_hidden)
    upright = stands & (np.abs(lean) < 2 * _MAX_LEAN)
    turn = np.clip(np.where(upright, -lean, 0.0), -_MAX_LEAN, _MAX_LEAN)
    return np.asarray(upright), np.asarray(turn)


def _has_straight_legs(joints: FloatArray, observations: BodyObservations) -> BoolArray:
    """Return which of N people have straight legs that the photo shows, (N,) bool."""
    ends = sided_indices(observations.skeleton, "knee", "ankle")
    legs_visible = observations.confidence[:, ends].min(1) > SURE_CONFIDENCE
    return np.asarray(standing_legs(joints).any(1) & legs_visible)


def _initial_poses_from_fit(
    fit: FittedBodies, observations: BodyObservations, turn: FloatArray, upright: BoolArray
) -> InitialPose:
    """Return initial poses from a finished fit: people rotated about the x axis of their view, with
    straighter legs where upright.

    3D landmarks bend knees towards the camera as they lean bodies towards it, and the picture shows
    neither.
    """
    about_x = Rotation.from_rotvec(np.stack([turn, 0 * turn, 0 * turn], -1)).as_matrix()
    root = (
        observations.turn
        @ about_x
        @ observations.turn.transpose(0, 2, 1)
        @ fit.rotations[:, 0].double().numpy()
    )
    pose = rotmat_to_rotvec(fit.rotations[:, 1:22].double().numpy())
    knees = np.subtract(joint_pair("knee"), 1)
    bend = pose[:, knees, 0]
    straighter = upright[:, None] & (np.abs(bend) < _MAX_APPARENT_BEND)
    pose[:, knees, 0] = np.where(straighter, _BEND_SHARE * bend, bend)
    return InitialPose(root, pose, fit.transl.double().numpy())


def _surely_stands(keypoints: Keypoints, person_observations: Observations) -> BoolArray:
    """Return which of N people surely stand or walk by picture and observer, (N,) bool."""
    return is_surely_standing(person_observations) & is_upright(keypoints, person_observations)


def _rotation_sigma(
    fit: FittedBodies, observations: BodyObservations, upright: FloatArray
) -> FloatArray | None:
    """Return the standard deviations (N, 22) of the rotations of pelvis and body joints, radians;
    None without 3D landmarks, NaN where unknown. Knees of upright people, of share ``upright``
    (N,), are known better.
    """
    if observations.depth_sigma is not None:
        spread = fit.problem.rotation_sigma(covariance(fit.problem, fit.unknowns))
        return np.asarray(np.minimum(spread.numpy(), np.pi))
    if observations.world is not None:
        names = (name.rpartition("_")[2].rstrip("123") for name in JOINT_NAMES[:22])
        sigma = np.tile([_ROTATION_SIGMA.get(name, np.nan) for name in names], (len(upright), 1))
        knees = sigma[:, joint_pair("knee")]
        known = knees**-2 + upright[:, None] / KNEE_SIGMA**2
        sigma[:, joint_pair("knee")] = known**-0.5
        return sigma
    return None
