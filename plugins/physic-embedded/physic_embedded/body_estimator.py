"""Estimate bodies by fitting the embedded body model to 2D keypoints, masks and, if given, 3D
landmarks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import (
        Bodies,
        Hints,
        Intrinsics,
        Keypoints,
        Observations,
        People,
        Skeleton,
    )
    from physic_embedded.body_fit.fit import FittedBodies
    from physic_embedded.body_fit.observations import BodyObservations
    from physic_embedded.body_fit.problem import InitialPose

    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.floating]

_MAX_APPARENT_BEND = 0.7  # radians by which a knee of an upright person may seem bent
_BEND_SHARE = 0.35  # share of it that counts as real
_ACCEPTED_RISE = 50.0  # of the fit's squared residuals: a larger cost of uprightness halves it
_MAX_LEAN = 0.44  # radians; a larger lean is a misread floor or no stance
_LIES = 0.5  # probability from which on a trunk without legs is not set upright
_MIN_LEG_CONFIDENCE = 0.5  # of knees and ankles of a person who stands

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


class EmbeddedBodies(BodyEstimator):
    """Body estimator that fits the embedded body model to 2D keypoints and 3D landmarks of all
    people at once.

    With world landmarks the fit starts from them in closed form. Without, it starts from standing
    and sitting people who face four ways, keeps the best, and leans on the pose prior: depths of
    limbs are then guesses. Finally, the outlines of bodies and masks are drawn together.

    The errors of keypoints and landmarks are those that the detector states. Without them,
    BlazePose's errors are used, and the floor corrects landmarks that lean towards the camera and
    feet at different depths.
    """

    written_for = 1
    reads = ("people", "intrinsics", "keypoints", "observations", "floor", "up", "original")

    _model: BodyModel | None = None

    def load(self, device: str = "cpu") -> None:
        """Load the body model. The fit always runs on the CPU, whatever the ``device``."""
        import torch

        from physic_core.body import load_body

        if self._model is None:
            # Newton's method differentiates gradients by differences, for which float32 is too
            # coarse.
            self._model = load_body("embedded").to(dtype=torch.float64)

    def close(self) -> None:
        """Release the body model."""
        self._model = None

    def infer(
        self,
        image: NDArray[np.uint8],
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Fit one body to each of N people, in metres in the camera frame.

        The fingers are at rest. ``observed`` marks the visible joints. ``rotation_sigma`` follows
        from the errors that the detector states of points and depths. Without them it is the same
        for all people, and None without 3D landmarks.

        Raises:
            BackendError: the body is not loaded, or the skeleton of the keypoints has no hips on
                the body.
        """
        import torch

        from physic_core.adapters.bodies import observed_joints
        from physic_core.adapters.devices import limited_threads
        from physic_core.body.bones import parameters_from_rotations
        from physic_core.types import Bodies, Observations
        from physic_embedded.body_fit.hidden_legs import (
            legs_hidden,
            pitch_sigma,
            with_hidden_legs,
        )
        from physic_embedded.body_fit.limb_keypoints import limb_keypoints
        from physic_embedded.body_fit.observations import observe_people
        from physic_embedded.body_fit.problem import UPRIGHT_SIGMA

        if self._model is None:
            raise BackendError("the embedded body is not loaded: call load() before infer()")
        keypoints = limb_keypoints(keypoints)
        observed = observed_joints(keypoints, intrinsics.height, intrinsics.width, finger_share=0)
        if not len(people):
            rotations, betas, transl = self._model.zero_pose(0)
            return Bodies(
                parameters_from_rotations(rotations, betas, None, transl), "embedded", observed
            )
        said = hints.observations or Observations.unknown(len(people))
        known = _known_up(hints)
        up = np.array([0.0, -1.0, 0.0]) if known is None else known
        observations = observe_people(keypoints, people, intrinsics, said)
        observations = with_hidden_legs(observations, keypoints.joint_set, said, up)
        cut = legs_hidden(observations, keypoints.joint_set)
        trunk = (cut & ~_lies(said)) | (known is not None)
        with torch.enable_grad(), limited_threads():
            fit, upright = self._fit(
                observations, intrinsics.matrix, keypoints.joint_set, up, trunk
            )
            fit = self._with_outlines(fit, observations, people, intrinsics.matrix, hints, cut)
            rotation_sigma = _rotation_sigma(fit, observations)
        return Bodies(
            parameters_from_rotations(fit.rotations, fit.betas, None, fit.transl),
            "embedded",
            observed,
            rotation_sigma=rotation_sigma,
            lean_sigma=np.where(upright, UPRIGHT_SIGMA, np.where(cut, pitch_sigma(said), np.nan)),
        )

    def _fit(
        self,
        observations: BodyObservations,
        camera: FloatArray,
        skeleton: Skeleton,
        up: FloatArray,
        trunk: BoolArray,
    ) -> tuple[FittedBodies, BoolArray]:
        """Fit bodies to keypoints and landmarks, and to the vertical where the ``trunk`` (N,) is
        known and the detector states no errors. Return the fit, and who was set upright: (N,) bool.
        """
        from physic_embedded.body_fit.multi_start import fit_without_world_landmarks

        assert self._model is not None
        fit = (
            fit_without_world_landmarks if observations.world is None else _fit_with_world_landmarks
        )(self._model, observations, camera, skeleton)
        if trunk.any() and observations.depth_sigma is None:
            return self._upright(fit, observations, camera, skeleton, up, trunk)
        return fit, np.zeros(len(trunk), bool)

    def _with_outlines(
        self,
        fit: FittedBodies,
        observations: BodyObservations,
        people: People,
        camera: FloatArray,
        hints: Hints,
        cut: BoolArray,
    ) -> FittedBodies:
        """Continue a fit with the outlines of masks and the limbs of the lifter, without the legs
        of people who are ``cut`` (N,).
        """
        from physic_embedded.body_fit.fit import fit_outlines, lifted_limbs
        from physic_embedded.body_fit.silhouette import outline_pairs, without_legs

        assert self._model is not None
        pairs = outline_pairs(self._model, fit, observations, people, camera, hints.original)
        lifted = None
        if observations.world is not None and observations.depth_sigma is None:
            lifted = lifted_limbs(fit, observations, camera, _known_up(hints), cut)
        return fit_outlines(self._model, fit, without_legs(self._model, pairs, cut), lifted)

    def _upright(
        self,
        fit: FittedBodies,
        observations: BodyObservations,
        camera: FloatArray,
        skeleton: Skeleton,
        up: FloatArray,
        trunk: BoolArray,
    ) -> tuple[FittedBodies, BoolArray]:
        """Repeat the fit with a known vertical, for people with known ``trunk`` (N,): feet level,
        and standing people upright.

        Return the fit, and who was set upright: (N,) bool.

        The landmarks are turned back by the lean before the fit. Turning the finished body instead
        would not do: its keypoints move, and the next optimisation turns it back.
        """
        from physic_core.body.posture import standing_legs
        from physic_embedded.body_fit.fit import fit_bodies
        from physic_embedded.body_fit.lean import lean_towards_camera
        from physic_embedded.body_fit.limb_keypoints import keypoint_indices
        from physic_embedded.body_fit.problem import FloorConstraint

        assert self._model is not None
        row = keypoint_indices(skeleton)
        up = np.asarray(up, np.float64)
        legs = [row[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]
        joints = fit.joints.double().numpy()
        lean = lean_towards_camera(joints, observations.turn, up)
        legs_seen = observations.confidence[:, legs].min(1) > _MIN_LEG_CONFIDENCE
        upright = standing_legs(joints).any(1) & legs_seen & trunk & (np.abs(lean) < 2 * _MAX_LEAN)
        turn = np.clip(np.where(upright, -lean, 0.0), -_MAX_LEAN, _MAX_LEAN)
        again = fit
        for _ in range(2):
            again = fit_bodies(
                self._model,
                observations,
                camera,
                skeleton,
                _restart(fit, observations, turn, upright),
                floor=FloorConstraint(up, trunk, upright, turn),
            )
            costly = upright & (again.loss - fit.loss > _ACCEPTED_RISE)
            if not costly.any():
                break
            turn = np.where(costly, turn / 2, turn)
            upright = upright & ~costly
        return again, upright


def _known_up(hints: Hints) -> FloatArray | None:
    """Return the normal of the floor, else up (3,), or None."""
    return hints.up if hints.floor is None else hints.floor.normal


def _lies(said: Observations) -> BoolArray:
    """Return which of N people probably lie, (N,) bool."""
    from physic_core.types.observations import POSTURES

    return np.asarray(said.posture[:, POSTURES.index("lie")] > _LIES)


def _rotation_sigma(fit: FittedBodies, observations: BodyObservations) -> FloatArray | None:
    """Return the standard deviations (N, 22) of the rotations of pelvis and body joints, radians;
    None without 3D landmarks.
    """
    from physic_embedded.body_fit.newton import covariance

    if observations.depth_sigma is not None:
        spread = fit.problem.rotation_sigma(covariance(fit.problem, fit.unknowns))
        return np.asarray(np.minimum(spread.numpy(), np.pi))
    if observations.world is not None:
        return np.tile(_landmark_sigma(), (len(observations.points), 1))
    return None


def _landmark_sigma() -> FloatArray:
    """Return the standard deviations (22,) of the rotations of pelvis and body joints, radians; NaN
    where unknown.
    """
    from physic_core.body.joints import JOINT_NAMES

    names = (name.rpartition("_")[2].rstrip("123") for name in JOINT_NAMES[:22])
    return np.array([_ROTATION_SIGMA.get(name, np.nan) for name in names])


def _fit_with_world_landmarks(
    model: BodyModel,
    observations: BodyObservations,
    camera: FloatArray,
    skeleton: Skeleton,
) -> FittedBodies:
    """Fit bodies to keypoints and 3D landmarks, starting from the pose of the landmarks."""
    from physic_embedded.body_fit.fit import fit_bodies
    from physic_embedded.body_fit.problem import InitialPose
    from physic_embedded.body_fit.start import initial_translation, pose_from_landmarks

    assert observations.world is not None
    roots = []
    poses = []
    places = []
    for i, landmarks in enumerate(observations.world):
        turned = landmarks @ observations.turn[i].T
        root, pose = pose_from_landmarks(turned, skeleton)
        roots.append(root)
        poses.append(pose)
        places.append(initial_translation(turned, observations, i, camera))
    return fit_bodies(
        model,
        observations,
        camera,
        skeleton,
        InitialPose(np.array(roots), np.array(poses), np.array(places)),
    )


def _restart(
    fit: FittedBodies, observations: BodyObservations, turn: FloatArray, upright: BoolArray
) -> InitialPose:
    """Return initial poses from a finished fit: people rotated about the x axis of their view, with
    straighter legs where upright.

    3D landmarks bend knees towards the camera as they lean bodies towards it, and the picture shows
    neither.
    """
    from scipy.spatial.transform import Rotation

    from physic_core.body import JOINT_INDEX
    from physic_core.geometry.rotations import rotmat_to_rotvec
    from physic_embedded.body_fit.problem import InitialPose

    about_x = Rotation.from_rotvec(np.stack([turn, 0 * turn, 0 * turn], -1)).as_matrix()
    root = (
        observations.turn
        @ about_x
        @ observations.turn.transpose(0, 2, 1)
        @ fit.rotations[:, 0].double().numpy()
    )
    pose = rotmat_to_rotvec(fit.rotations[:, 1:22].double().numpy())
    for knee in (JOINT_INDEX["left_knee"] - 1, JOINT_INDEX["right_knee"] - 1):
        bend = pose[:, knee, 0]
        pose[:, knee, 0] = np.where(
            upright & (np.abs(bend) < _MAX_APPARENT_BEND), _BEND_SHARE * bend, bend
        )
    return InitialPose(root, pose, fit.transl.double().numpy())
