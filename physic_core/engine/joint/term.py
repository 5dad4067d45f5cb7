"""Base class of the terms of the joint energy, and their inputs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import torch
from torch import Tensor

from physic_core.engine.joint.contact_state import ContactState
from physic_core.engine.joint.state import Estimate
from physic_core.engine.joint.visibility import Visibility
from physic_core.types.short_repr import ShortRepr

RobustLoss = Callable[[Tensor], Tensor]
"""Robust loss of squared residuals."""


@dataclass(frozen=True)
class Snapshot(ShortRepr):
    """Visibility, contacts and vertices at the last refresh; constant until the next one.

    Attributes:
        visibility: of each vertex.
        contacts: nearest scene point of each vertex, and distances.
        vertices: (B, n, 3) subsampled vertices, metres.
        scale: of the scene.
    """

    visibility: Visibility
    contacts: ContactState
    vertices: Tensor
    scale: float


@dataclass(frozen=True)
class PosedBodies(ShortRepr):
    """Posed bodies and scene parameters of one energy evaluation, differentiable. B people, n subsampled vertices.

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


class Term(ABC):
    """One summand of the energy (paper Eq. 5), or several that are evaluated together.

    Attributes:
        weights: name -> (B, n) or (B,) weights since the last :meth:`refresh`; 0 excludes a vertex or person.
    """

    weights: Mapping[str, Tensor] = MappingProxyType({})

    @property
    def links(self) -> Tensor:
        """Pairs (k, 2) int64 of people who share energy since the last :meth:`refresh`; by default none."""
        return torch.zeros(0, 2, dtype=torch.int64)

    def refresh(self, snapshot: Snapshot) -> None:  # noqa: B027 - most terms have constant weights
        """Update :attr:`weights`, which are constant until the next call. By default nothing changes."""

    @abstractmethod
    def __call__(self, bodies: PosedBodies) -> Mapping[str, Tensor]:
        """Return the weighted energies, differentiable: name -> (B,) per person; "scale", of the scene, is (1,)."""
