"""Static contact prior: the parts of a body that usually touch the world, by what the body is doing."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior, Options
from physic_core.types import ContactProbability

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Bodies, People

    FloatArray = NDArray[np.floating]

__all__ = ["StaticContact", "sits"]

# Contact set -> joints of which one must be seen.
_NEEDS: dict[str, tuple[str, ...]] = {
    "left_foot": ("left_ankle", "left_foot"),
    "right_foot": ("right_ankle", "right_foot"),
    "left_sole": ("left_ankle", "left_foot"),
    "right_sole": ("right_ankle", "right_foot"),
    "thighs": ("left_knee", "right_knee", "left_hip", "right_hip"),
    "gluteus": ("left_hip", "right_hip"),
    "back": ("left_shoulder", "right_shoulder"),
    "left_hand": ("left_wrist",),
    "right_hand": ("right_wrist",),
}
_SEAT = ("thighs", "gluteus", "back")


class StaticContactOptions(Options):
    """Settings of the static contact prior."""

    soles: float = Field(1.0, ge=0, le=1, description="probability of soles")
    feet: float = Field(0.5, ge=0, le=1, description="probability of the rest of the lower half of the feet")
    hands: float = Field(0.5, ge=0, le=1, description="probability of palms and fingers")
    seat: float = Field(0.5, ge=0, le=1, description="probability of undersides of the thighs and of the seat")
    back: float = Field(0.5, ge=0, le=1, description="probability of the back")
    seat_by_pose: bool = Field(
        True, description="seat and back only for people whose hips are bent or whose trunk lies; else for everybody"
    )
    sitting_hip_deg: float = Field(
        140.0, gt=0, le=180, description="people sit when the mean angle between trunk and thighs is below this"
    )
    lying_trunk_deg: float = Field(
        60.0, ge=0, le=90, description="people lie when the trunk is tilted from the image's vertical by more than this"
    )


class StaticContact(ContactPrior):
    """Feet, thighs, seat, back and hands, after the idea of PROX; parts of unseen joints have probability 0."""

    Options: ClassVar[type[Options]] = StaticContactOptions
    options: StaticContactOptions

    _model: BodyModel | None = None

    def load(self, device: str = "cpu") -> None:
        """Load the body whose vertices are labelled."""
        from physic_core.body import load_body

        if self._model is None:
            self._model = load_body("embedded")

    def close(self) -> None:
        """Drop the body."""
        self._model = None

    def infer(self, image: NDArray[np.uint8], people: People, bodies: Bodies) -> ContactProbability:
        """N people with bodies -> probability (N, V) on the embedded body, with its mesh if the bodies are others.

        Raises:
            BackendError: it is not loaded, or the bodies are of another model and without joints.
        """
        from physic_core.body import JOINT_INDEX
        from physic_core.body.conversion import rest_mesh_of_model

        if self._model is None:
            raise BackendError("the static contact prior was asked before it was loaded: call load() first")
        joints = self._joints(bodies)
        count = len(joints)
        observed = bodies.observed
        observed = np.ones((count, joints.shape[1]), bool) if observed is None else np.asarray(observed)
        options = self.options
        seated = np.ones(count, bool)
        if options.seat_by_pose:
            seated = sits(joints, options.sitting_hip_deg) | _lies(joints, options.lying_trunk_deg)
        worth = {"thighs": options.seat, "gluteus": options.seat, "back": options.back}
        for side in ("left", "right"):
            worth |= {f"{side}_foot": options.feet, f"{side}_sole": options.soles, f"{side}_hand": options.hands}
        probability = np.zeros((count, self._model.num_vertices), np.float32)
        for name, value in worth.items():
            seen = observed[:, [JOINT_INDEX[joint] for joint in _NEEDS[name]]].any(1)
            if name in _SEAT:
                seen &= seated
            ids = self._model.contact_sets[name].cpu().numpy()
            given = np.where(seen, np.float32(value), np.float32(0))[:, None]
            probability[:, ids] = np.maximum(probability[:, ids], given)
        rest = None if bodies.body_model == self._model.name else rest_mesh_of_model(self._model)
        return ContactProbability(probability, self._model.topology, rest)

    def _joints(self, bodies: Bodies) -> FloatArray:
        import torch

        from physic_core.body.parameters import rotations_from_parameters
        from physic_core.geometry.tensors import tensor

        assert self._model is not None
        if bodies.body_model != self._model.name:
            if bodies.joints is None:
                raise BackendError(
                    f"the static contact prior knows the embedded body, and {bodies.body_model!r} bodies came without "
                    "joints: use it in the pipeline, or choose no contact prior"
                )
            return bodies.joints.astype(np.float64)
        p = bodies.parameters
        with torch.no_grad():
            betas, transl = tensor(p.betas), tensor(p.transl)
            out = self._model(rotations_from_parameters(p), betas, transl, joints_only=True)
        return out.joints.double().numpy()


def sits(joints: FloatArray, hip_deg: float) -> NDArray[np.bool_]:
    """Who sits: the thighs make a mean angle of less than ``hip_deg`` with the trunk. Who squats or lunges counts too.

    Args:
        joints: (N, 55, 3), any frame.
        hip_deg: between the ways from hip to knee and from hips to neck; 180 stands.
    """
    from physic_core.body import JOINT_INDEX as INDEX

    trunk = joints[:, INDEX["neck"]] - joints[:, INDEX["pelvis"]]
    angles = [
        _angle_deg(joints[:, INDEX[f"{side}_knee"]] - joints[:, INDEX[f"{side}_hip"]], trunk)
        for side in ("left", "right")
    ]
    return np.asarray((angles[0] + angles[1]) / 2 < hip_deg)


def _lies(joints: FloatArray, trunk_deg: float) -> NDArray[np.bool_]:
    """Whose trunk is tilted from the image's vertical, which the floor's normal mostly is near, by more than this."""
    from physic_core.body import JOINT_INDEX as INDEX

    trunk = joints[:, INDEX["neck"]] - joints[:, INDEX["pelvis"]]
    return np.asarray(_angle_deg(trunk, np.array([0.0, -1.0, 0.0])) > trunk_deg)


def _angle_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    cosine = (a * b).sum(-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1) + 1e-9)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
