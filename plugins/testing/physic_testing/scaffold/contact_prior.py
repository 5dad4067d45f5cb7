"""Contact probability independent of the photo: the soles of every person."""

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


class TemplateOptions(Options):
    """Settings of Template."""

    probability: float = Field(
        0.8, gt=0, le=1, description="contact probability of the vertices of the soles"
    )


class Template(ContactPrior):
    """Returns one probability for the vertices of all soles, and zero elsewhere."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions

    _body: BodyModel | None = None

    def load(self, device: str = "cpu") -> None:
        """Load the body model, which lists the vertices of the soles."""
        from physic_core.body import load_body

        if self._body is None:
            self._body = load_body("embedded")

    def close(self) -> None:
        """Release the body model."""
        self._body = None

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """N people with their bodies -> probability (N, V)."""
        if self._body is None:
            raise BackendError("the body model is not loaded: call load() first")
        if bodies.body_model != self._body.name:
            raise BackendError(
                f"this prior needs the body model {self._body.name!r}, got {bodies.body_model!r}"
            )
        probability = np.zeros((len(people), self._body.num_vertices), np.float32)
        for side in ("left_sole", "right_sole"):
            probability[:, self._body.contact_sets[side].numpy()] = self.options.probability
        return ContactProbability(probability, self._body.topology)
