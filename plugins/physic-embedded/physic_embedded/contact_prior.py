"""Static contact prior: the body parts that usually touch the scene, depending on the pose."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.body.posture import angle_deg
from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior, Options
from physic_core.types import ContactProbability
from physic_core.types.skeletons import SIDES
from physic_embedded.held_edges import hands_at_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Bodies, People

    FloatArray = NDArray[np.floating]

# Contact set -> joints of which one must be seen.
_VISIBLE_JOINTS: dict[str, tuple[str, ...]] = {
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
_SITTING_SETS = ("thighs", "gluteus", "back")
_SITTING_HIP_DEG = 140.0  # people sit when the mean angle between trunk and thighs is below this
# people lie when the trunk is tilted from the image's vertical by more than this
_LYING_TRUNK_DEG = 60.0


class StaticContactOptions(Options):
    """Settings of the static contact prior."""

    soles: float = Field(1.0, ge=0, le=1, description="probability of soles")
    feet: float = Field(
        0.5, ge=0, le=1, description="probability of the rest of the lower half of the feet"
    )
    hands: float = Field(0.5, ge=0, le=1, description="probability of palms and fingers")
    held: float = Field(
        0.9, ge=0, le=1, description="probability of hands at a straight edge, such as a bar's"
    )
    seat: float = Field(
        0.5, ge=0, le=1, description="probability of undersides of the thighs and of the seat"
    )
    back: float = Field(0.5, ge=0, le=1, description="probability of the back")


class StaticContact(ContactPrior):
    """Contact prior of fixed body parts: feet, thighs, buttocks, back and hands (PROX).

    Body parts without observed joints get probability 0, except hands at a straight edge in the
    picture.
    """

    written_for = 1
    Options: ClassVar[type[Options]] = StaticContactOptions
    options: StaticContactOptions

    _model: BodyModel | None = None

    def load(self, device: str = "cpu") -> None:
        """Load the body model that defines the vertices."""
        from physic_core.body import load_body

        if self._model is None:
            self._model = load_body("embedded")

    def close(self) -> None:
        """Release the body model."""
        self._model = None

    def infer(self, image: NDArray[np.uint8], people: People, bodies: Bodies) -> ContactProbability:
        """Return the contact probability (N, V) on the vertices of the embedded body.

        If the bodies are of another model, the T-pose mesh of the embedded body is returned too.

        Raises:
            BackendError: it is not loaded, or the bodies are of another model and without joints.
        """
        from physic_core.body import JOINT_INDEX

        if self._model is None:
            raise BackendError("the static contact prior is not loaded: call load() before infer()")
        joints = self._joints(bodies)
        count = len(joints)
        observed = bodies.observed
        observed = (
            np.ones((count, joints.shape[1]), bool) if observed is None else np.asarray(observed)
        )
        options = self.options
        seated = is_sitting(joints) | _is_lying(joints)
        worth = {"thighs": options.seat, "gluteus": options.seat, "back": options.back}
        for side in ("left", "right"):
            worth |= {
                f"{side}_foot": options.feet,
                f"{side}_sole": options.soles,
                f"{side}_hand": options.hands,
            }
        probability = np.zeros((count, self._model.num_vertices), np.float32)
        for name, value in worth.items():
            seen = observed[:, [JOINT_INDEX[joint] for joint in _VISIBLE_JOINTS[name]]].any(1)
            if name in _SITTING_SETS:
                seen &= seated
            ids = self._model.contact_sets[name].cpu().numpy()
            given = np.where(seen, np.float32(value), np.float32(0))[:, None]
            probability[:, ids] = np.maximum(probability[:, ids], given)
        for k, held in enumerate(hands_at_edges(image, people).T):
            ids = self._model.contact_sets[f"{SIDES[k]}_hand"].cpu().numpy()
            given = np.where(held, np.float32(options.held), np.float32(0))[:, None]
            probability[:, ids] = np.maximum(probability[:, ids], given)
        rest = None
        if bodies.body_model != self._model.name:
            from physic_core.body.convert.bodies import rest_mesh_of_model

            rest = rest_mesh_of_model(self._model)
        return ContactProbability(probability, self._model.topology, rest)

    def _joints(self, bodies: Bodies) -> FloatArray:
        """Return the SMPL-X joints (N, 55, 3) of the bodies."""
        import torch

        from physic_core.body.bones import rotations_from_parameters
        from physic_core.geometry.tensors import tensor

        assert self._model is not None
        if bodies.body_model != self._model.name:
            if bodies.joints is None:
                raise BackendError(
                    "the static contact prior needs bodies of the embedded model or joints, got "
                    f"{bodies.body_model!r} bodies without joints: use it in the pipeline, or "
                    f"choose no contact prior"
                )
            return bodies.joints.astype(np.float64)
        p = bodies.parameters
        with torch.no_grad():
            betas = tensor(p.betas)
            transl = tensor(p.transl)
            out = self._model(rotations_from_parameters(p), betas, transl, joints_only=True)
        return out.joints.double().numpy()


def is_sitting(joints: FloatArray) -> NDArray[np.bool_]:
    """Return which people sit, squat or lunge: the mean angle between thighs and trunk is below 140
    degrees.

    Args:
        joints: (N, 55, 3), any frame.
    """
    from physic_core.body import JOINT_INDEX as INDEX

    trunk = joints[:, INDEX["neck"]] - joints[:, INDEX["pelvis"]]
    angles = [
        angle_deg(joints[:, INDEX[f"{side}_knee"]] - joints[:, INDEX[f"{side}_hip"]], trunk)
        for side in ("left", "right")
    ]
    return np.asarray((angles[0] + angles[1]) / 2 < _SITTING_HIP_DEG)


def _is_lying(joints: FloatArray) -> NDArray[np.bool_]:
    """Return which people lie: the trunk is tilted from the image's vertical by more than 60
    degrees.
    """
    from physic_core.body import JOINT_INDEX as INDEX

    trunk = joints[:, INDEX["neck"]] - joints[:, INDEX["pelvis"]]
    return np.asarray(angle_deg(trunk, np.array([0.0, -1.0, 0.0])) > _LYING_TRUNK_DEG)
