"""Estimate bodies by fitting the embedded body model to 2D keypoints, masks and, if given, 3D
landmarks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import Bodies, Hints, Intrinsics, Keypoints, People, UInt8Array


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
            # The Hessian is a difference of gradients, for which float32 is too coarse.
            self._model = load_body("embedded").to(dtype=torch.float64)

    def close(self) -> None:
        """Release the body model."""
        self._model = None

    def infer(
        self,
        image: UInt8Array,
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
        from physic_embedded.body_fit.people import fit_people

        if self._model is None:
            raise BackendError("the embedded body is not loaded: call load() before infer()")
        return fit_people(self._model, people, intrinsics, keypoints, hints)
