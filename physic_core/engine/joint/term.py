"""Base class of the terms of the joint energy, their inputs, and weighted sums of robust losses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from physic_core.engine.joint.snapshot import ContactState, Visibility
from physic_core.engine.joint.variables import Estimate
from physic_core.geometry.robust import loss_with_slope
from physic_core.types.short_repr import ShortRepr


@dataclass(frozen=True)
class RobustSum:
    """Weighted sum of robust losses, ``sum_v w_v rho(r_v^2 / sigma^2)``, of residuals (B, n) or
    (p,).

    Attributes:
        kind: of loss, see :mod:`physic_core.geometry.robust`.
        scale: of the loss, in sigmas.
        sigma: expected residual.
        weight: (B, n), 0 excludes a residual.
    """

    kind: str
    scale: float
    sigma: float
    weight: Tensor

    def values_and_slopes(self, residual: Tensor) -> tuple[Tensor, Tensor]:
        """Return the summands (...) and their derivatives with respect to the residuals (...)."""
        loss, slope = loss_with_slope(
            self.kind, (residual * (1.0 / (self.sigma * self.scale))).square(), self.scale
        )
        slopes = self.weight * (2.0 / self.sigma**2) * residual * slope
        return self.weight * self.scale**2 * loss, slopes


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
    """Posed bodies and scene parameters of one energy evaluation, differentiable.

    B people, n subsampled vertices.

    Attributes:
        vertices: (B, n, 3) metres, camera frame.
        joints: (B, 55, 3) metres.
        keypoints: (B, J, 3) metres, landmarks of the keypoints' joint set.
        estimate: parameters of bodies and scene.
        deviation: (B, P) free parameters of people minus those at the start, see
            ``State.deviation``.
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
        weights: name -> (B, n) or (B,) weights since the last :meth:`refresh`; 0 excludes a vertex
            or person.
    """

    weights: Mapping[str, Tensor] = MappingProxyType({})

    @property
    def links(self) -> Tensor:
        """Pairs (k, 2) int64 of people who share energy since the last :meth:`refresh`; by default
        none.
        """
        return torch.zeros(0, 2, dtype=torch.int64)

    def refresh(self, snapshot: Snapshot) -> None:  # noqa: B027 - most terms have constant weights
        """Update :attr:`weights`, which are constant until the next call.

        By default nothing changes.
        """

    @abstractmethod
    def __call__(self, bodies: PosedBodies) -> Mapping[str, Tensor]:
        """Return the weighted energies, differentiable: name -> (B,) per person; "scale", of the
        scene, is (1,).
        """


class VertexDistances(NamedTuple):
    """Place of B people's vertices at one evaluation, in the unit of the scene: (B, n) each."""

    scene: Tensor
    """Signed distance to the plane through the nearest scene point, negative inside."""
    floor: Tensor
    """Height over the floor."""
    last_floor: Tensor
    """The same by the scale of the scene at the last refresh, to which it gives no gradient."""
    log_depth: Tensor
    """Logarithm of the depth, metres."""
    log_scale: Tensor
    """(B, 1) logarithm of the scale of the scene and of the depth offset of the person."""


class SurfaceSlopes(NamedTuple):
    """Derivatives of residuals by distances of the vertices, named as in :class:`VertexDistances`:
    one number, or (B, n) numbers or Booleans; None for those that are 0.
    """

    scene: Tensor | float | None = None
    floor: Tensor | None = None
    last_floor: Tensor | None = None
    log_depth: float | None = None


class SurfaceResidual(NamedTuple):
    """Residuals (B, n) of a surface term, and their derivatives."""

    value: Tensor
    slopes: SurfaceSlopes


class SurfaceTerm(ABC):
    """Robust sum over the residuals of vertices, evaluated with the others of its kind by
    :class:`physic_core.engine.joint.terms.fused_surface.SurfaceTerms`.

    Attributes:
        name: of the energy, and of its weights.
        weight: of the term; 0 turns it off.
    """

    name: ClassVar[str]
    weight: float

    @abstractmethod
    def refresh(self, snapshot: Snapshot) -> RobustSum:
        """Return the robust sum over the residuals until the next call."""

    @abstractmethod
    def residual(self, at: VertexDistances) -> SurfaceResidual:
        """Return the residuals of vertices, and their derivatives by the place."""
