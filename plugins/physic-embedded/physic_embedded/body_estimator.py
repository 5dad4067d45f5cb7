"""Bodies: the embedded body fitted to keypoints and, where there are any, to 3D landmarks."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator, Options

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Bodies, Hints, Intrinsics, Keypoints, People, Skeleton
    from physic_embedded.body_fit.fit import BodyFit
    from physic_embedded.body_fit.problem import FitSettings, Start
    from physic_embedded.body_fit.views import Views

    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.floating]

__all__ = ["EmbeddedBodies"]

_SLIGHT_BEND = 0.7  # radians that a knee of somebody who stands may seem to bend
_TRUE_BEND = 0.35  # share of it that is taken to be true
_MOST_LEAN = 0.44  # radians; a larger lean is a misread floor or no stance


class EmbeddedBodiesOptions(Options):
    """Settings of the body fit."""

    iterations: int = Field(80, ge=10, le=1000, description="of L-BFGS, before Newton's method finds the minimum")
    cure_lean: bool = Field(
        True, description="set people who stand upright on the floor, where the floor is known; landmarks lean forward"
    )
    accepted_rise: float = Field(
        50.0, gt=0, description="rise of the fit's squared residuals that uprightness may cost before it is halved"
    )


class EmbeddedBodies(BodyEstimator):
    """Fits the embedded body to 2D keypoints and world landmarks, all people at once.

    With world landmarks the fit starts from them in closed form. Without, it starts from standing and sitting people
    who face four ways, keeps the best, and leans on the pose prior: depths of limbs are then guesses.
    """

    Options: ClassVar[type[Options]] = EmbeddedBodiesOptions
    options: EmbeddedBodiesOptions

    _model: BodyModel | None = None

    def load(self, device: str = "cpu") -> None:
        """Load the body; the fit runs on the CPU whatever the device, where one person takes a fraction of a second."""
        import torch

        from physic_core.body import load_body

        if self._model is None:
            # Newton's method differentiates gradients by differences, for which float32 is too coarse.
            self._model = load_body("embedded").to(dtype=torch.float64)

    def close(self) -> None:
        """Drop the body."""
        self._model = None

    def infer(
        self,
        image: NDArray[np.uint8],
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """N people -> N bodies in metres, camera frame; fingers at rest; ``observed`` says which joints are seen.

        Raises:
            BackendError: the body is not loaded, or the joint set of the keypoints has no hips that bodies know.
        """
        import torch

        from physic_core.adapters.observed import observed_joints
        from physic_core.adapters.threads import limited_threads
        from physic_core.body.parameters import parameters_from_rotations
        from physic_core.types import Bodies
        from physic_embedded.body_fit.limb_keypoints import limb_keypoints
        from physic_embedded.body_fit.problem import FitSettings
        from physic_embedded.body_fit.views import people_views
        from physic_embedded.body_fit.without_world import fit_without_landmarks

        if self._model is None:
            raise BackendError("the embedded body was asked for before it was loaded: call load() first")
        keypoints = limb_keypoints(keypoints)
        settings = FitSettings(iterations=self.options.iterations)
        camera = intrinsics.matrix
        observed = observed_joints(keypoints, intrinsics.height, intrinsics.width, finger_share=0)
        if not len(people):
            rotations, betas, transl = self._model.zero_pose(0)
            return Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded", observed)
        views = people_views(keypoints, people, intrinsics)
        with torch.enable_grad(), limited_threads():
            fit = (_fit_with_landmarks if views.world is not None else fit_without_landmarks)(
                self._model, views, camera, keypoints.joint_set, settings
            )
            if hints.floor is not None:
                fit = self._on_floor(fit, views, camera, keypoints.joint_set, settings, hints.floor.normal)
        return Bodies(parameters_from_rotations(fit.rotations, fit.betas, None, fit.transl), "embedded", observed)

    def _on_floor(
        self, fit: BodyFit, views: Views, camera: FloatArray, skeleton: Skeleton, settings: FitSettings, up: FloatArray
    ) -> BodyFit:
        """The fit repeated with what the floor says: feet are level, and who stands is upright.

        The landmarks are turned back by the lean before the fit. Turning the finished body instead would not do: its
        keypoints move, and the next optimisation turns it back.
        """
        from physic_embedded.body_fit.fit import fit_bodies
        from physic_embedded.body_fit.lean import lean_towards_camera, standing
        from physic_embedded.body_fit.limb_keypoints import point_rows

        assert self._model is not None
        row = point_rows(skeleton)
        up = np.asarray(up, np.float64)
        legs = [row[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]
        joints = fit.joints.double().numpy()
        lean = lean_towards_camera(joints, views.turn, up)
        stands = standing(joints, views.confidence[:, legs].min(1)) & (np.abs(lean) < 2 * _MOST_LEAN)
        if not self.options.cure_lean:
            stands = np.zeros_like(stands)
        turn = np.clip(np.where(stands, -lean, 0.0), -_MOST_LEAN, _MOST_LEAN)
        again = fit
        for _ in range(2):
            again = fit_bodies(
                self._model,
                views,
                camera,
                skeleton,
                _turned_start(fit, views, turn, stands),
                settings,
                floor_up=up,
                stands=stands,
                lean=turn,
            )
            costly = stands & (again.loss - fit.loss > self.options.accepted_rise)
            if not costly.any():
                break
            turn, stands = np.where(costly, turn / 2, turn), stands & ~costly
        return again


def _fit_with_landmarks(
    model: BodyModel, views: Views, camera: FloatArray, skeleton: Skeleton, settings: FitSettings
) -> BodyFit:
    from physic_embedded.body_fit.fit import fit_bodies
    from physic_embedded.body_fit.problem import Start
    from physic_embedded.body_fit.start import place, pose_from_landmarks

    assert views.world is not None
    roots, poses, places = [], [], []
    for i, landmarks in enumerate(views.world):
        turned = landmarks @ views.turn[i].T
        root, pose = pose_from_landmarks(turned, skeleton)
        roots.append(root)
        poses.append(pose)
        places.append(place(turned, views, i, camera))
    return fit_bodies(
        model, views, camera, skeleton, Start(np.array(roots), np.array(poses), np.array(places)), settings
    )


def _turned_start(fit: BodyFit, views: Views, turn: FloatArray, stands: BoolArray) -> Start:
    """A finished fit as a start, its people turned about the x axis of their view, who stands on straighter legs.

    3D landmarks bend knees towards the camera as they lean bodies towards it, and the picture shows neither.
    """
    import roma
    from scipy.spatial.transform import Rotation

    from physic_core.body import JOINT_INDEX
    from physic_embedded.body_fit.problem import Start

    about_x = Rotation.from_rotvec(np.stack([turn, 0 * turn, 0 * turn], -1)).as_matrix()
    root = views.turn @ about_x @ views.turn.transpose(0, 2, 1) @ fit.rotations[:, 0].double().numpy()
    pose = roma.rotmat_to_rotvec(fit.rotations[:, 1:22].double()).numpy()
    for knee in (JOINT_INDEX["left_knee"] - 1, JOINT_INDEX["right_knee"] - 1):
        bend = pose[:, knee, 0]
        pose[:, knee, 0] = np.where(stands & (np.abs(bend) < _SLIGHT_BEND), _TRUE_BEND * bend, bend)
    return Start(root, pose, fit.transl.double().numpy())
