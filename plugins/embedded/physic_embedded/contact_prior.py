"""Static contact prior: the skin of the body parts that usually touch the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior, Options
from physic_core.types import ContactProbability

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import Bodies, People, UInt8Array

# Contact set -> option with its probability, and joints of which one must be seen.
_PARTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "left_foot": ("feet", ("left_ankle", "left_foot")),
    "right_foot": ("feet", ("right_ankle", "right_foot")),
    "left_sole": ("soles", ("left_ankle", "left_foot")),
    "right_sole": ("soles", ("right_ankle", "right_foot")),
    "thighs": ("seat", ("left_knee", "right_knee", "left_hip", "right_hip")),
    "gluteus": ("seat", ("left_hip", "right_hip")),
    "back": ("back", ("left_shoulder", "right_shoulder")),
    "left_hand": ("hands", ("left_wrist",)),
    "right_hand": ("hands", ("right_wrist",)),
}


class StaticContactOptions(Options):
    """Settings of the static contact prior."""

    soles: float = Field(1.0, ge=0, le=1, description="probability of soles")
    feet: float = Field(
        0.5, ge=0, le=1, description="probability of the rest of the lower half of the feet"
    )
    hands: float = Field(0.5, ge=0, le=1, description="probability of palms and fingers")
    seat: float = Field(
        0.5, ge=0, le=1, description="probability of undersides of the thighs and of the seat"
    )
    back: float = Field(0.5, ge=0, le=1, description="probability of the back")


class StaticContact(ContactPrior):
    """Contact prior of fixed body parts: feet, thighs, buttocks, back and hands (PROX).

    Body parts without observed joints get probability 0. The engine decides
    whether a part touches: it weighs each part by what the picture shows of it.
    """

    written_for = 1
    Options = StaticContactOptions
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

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Return the contact probability (N, V) on the vertices of the embedded body.

        If the bodies are of another model, the T-pose mesh of the embedded body is returned too.

        Raises:
            BackendError: it is not loaded.
        """
        from physic_core.body import JOINT_INDEX

        if self._model is None:
            raise BackendError("the static contact prior is not loaded: call load() before infer()")
        count = len(bodies.parameters)
        observed = (
            np.ones((count, len(JOINT_INDEX)), bool)
            if bodies.observed is None
            else np.asarray(bodies.observed)
        )
        probability = np.zeros((count, self._model.num_vertices), np.float32)
        for name, (option, joints) in _PARTS.items():
            rows = [JOINT_INDEX[joint] for joint in joints]
            is_visible = observed[:, rows].any(1, keepdims=True)
            ids = self._model.contact_sets[name].numpy()
            part_probability = np.float32(getattr(self.options, option)) * is_visible
            probability[:, ids] = np.maximum(probability[:, ids], part_probability)
        rest = None
        if bodies.body_model != self._model.name:
            from physic_core.body import rest_mesh_of_model

            rest = rest_mesh_of_model(self._model)
        return ContactProbability(probability, self._model.topology, rest)
