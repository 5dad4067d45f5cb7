"""Regularisation L_reg: deviation of mesh and parameters from the start (paper sec. 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.bounds import NotNegative, Positive
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import View

__all__ = ["RegularisationSettings", "RegularisationTerm", "mesh_deviation", "mesh_weight", "prior"]


@dataclass(frozen=True)
class RegularisationSettings:
    """Deviation of the mesh in the root's frame, and of the parameters in units of their expected change.

    Attributes:
        sigma_m: expected change of a vertex of weight 1, root-relative, metres.
        visible_weight: of visible vertices.
        occluded_weight: of hidden vertices and those on invisible limbs.
        root_weight: of the root's rotation.
        pose_weight: of the rotations of the other joints.
        hands_weight: of the rotations of the fingers.
        shape_weight: of the shape.
        translation_weight: of the translation.
    """

    sigma_m: Positive = 0.06
    visible_weight: NotNegative = 0.01
    occluded_weight: NotNegative = 0.05
    root_weight: NotNegative = 0.3
    pose_weight: NotNegative = 1.0
    hands_weight: NotNegative = 1.0
    shape_weight: NotNegative = 1.0
    translation_weight: NotNegative = 0.05


def mesh_deviation(relative: Tensor, start: Tensor, weight: Tensor) -> Tensor:
    """L_reg of the mesh: ``sum_v w_v |v - v0|^2`` in the root's frame.

    Args:
        relative: (B, V, 3) from :func:`physic_core.engine.joint.distances.root_relative`, metres.
        start: (B, V, 3) root-relative vertices at the start, metres.
        weight: (B, V).

    Returns:
        (B,).
    """
    return (weight * (relative - start).square().sum(-1)).sum(-1)


def prior(deviation: Tensor, weight: Tensor) -> Tensor:
    """L_reg of the parameters, whitened or raw: ``sum_i w_i x_i^2``, (B, P) and (P,) -> (B,)."""
    return deviation.square() @ weight


def mesh_weight(view: View, visible: float, occluded: float, area: Tensor, *, occlusion_aware: bool = True) -> Tensor:
    """Weights (B, n) of the mesh's deviation: ``visible`` or ``occluded`` times the area of each vertex."""
    strong = ~view.visibility.in_play
    if occlusion_aware:
        strong = strong | view.visibility.hidden
    return torch.where(strong, occluded, visible).to(area.dtype) * area


class RegularisationTerm:
    """Mesh and parameters of each person; evaluated by :class:`physic_core.engine.joint.terms.surface.SurfaceTerms`."""

    def __init__(
        self, settings: RegularisationSettings, context: JointContext, state: State, *, occlusion_aware: bool
    ) -> None:
        self._settings, self._context, self._occlusion_aware = settings, context, occlusion_aware
        self._prior_weight = state.per_parameter(
            {
                "root": settings.root_weight,
                "pose": settings.pose_weight,
                "hands": settings.hands_weight,
                "betas": settings.shape_weight,
                "translation": settings.translation_weight,
                "offset": 1.0,
                "warp": 1.0,
            }
        )
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Set the weights of visible and hidden vertices."""
        s = self._settings
        weight = mesh_weight(
            view, s.visible_weight, s.occluded_weight, self._context.area, occlusion_aware=self._occlusion_aware
        )
        self.active = {"regularisation": weight / s.sigma_m**2}

    def energy(self, mesh: Tensor, deviation: Tensor) -> Tensor:
        """Deviation of the mesh (B,) and of the parameters (B, P) -> energy (B,)."""
        return mesh + prior(deviation, self._prior_weight)
