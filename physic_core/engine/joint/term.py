"""Interface of a term of the joint energy, and its inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from physic_core.engine.joint.contact_state import ContactState
from physic_core.engine.joint.state import Estimate
from physic_core.engine.joint.visibility import Visibility
from physic_core.types.short_repr import ShortRepr

__all__ = ["PosedBodies", "Rho", "Term", "View"]

Rho = Callable[[Tensor], Tensor]
"""Robust loss of squared residuals."""


@dataclass(frozen=True)
class View(ShortRepr):
    """Inputs that are fixed between two updates, so that the energy is smooth for a line search.

    Attributes:
        visibility: of each vertex.
        contacts: nearest scene point of each vertex, and distances.
        vertices: (B, n, 3) tracked vertices at the update, metres.
        scale: of the scene at the update.
    """

    visibility: Visibility
    contacts: ContactState
    vertices: Tensor
    scale: float


@dataclass(frozen=True)
class PosedBodies(ShortRepr):
    """Bodies and scene of one evaluation, differentiable. B people, n tracked vertices.

    Attributes:
        vertices: (B, n, 3) metres, camera frame.
        joints: (B, 55, 3) metres.
        keypoints: (B, J, 3) metres, landmarks of the keypoints' joint set.
        estimate: parameters of bodies and scene.
        deviation: (B, P) free parameters of people minus those at the start, see ``State.deviation``.
        scale_deviation: () deviation of the scene's scale from the start.
    """

    vertices: Tensor
    joints: Tensor
    keypoints: Tensor
    estimate: Estimate
    deviation: Tensor
    scale_deviation: Tensor


class Term(Protocol):
    """One summand of the energy (paper Eq. 5), or several that are evaluated together.

    Attributes:
        active: name -> (B, n) or (B,) weights since the last :meth:`refresh`; 0 leaves a vertex or person out.
    """

    active: dict[str, Tensor]

    def refresh(self, view: View) -> None:
        """Compute the weights; they stay fixed until the next call."""

    def __call__(self, bodies: PosedBodies) -> Mapping[str, Tensor]:
        """Weighted energies, differentiable: name -> (B,) of each person; "scale", of the scene, is (1,)."""
