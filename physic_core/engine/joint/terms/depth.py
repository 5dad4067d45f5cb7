"""Depth term L_d: compares the depth of visible vertices with the depth map at their pixels (paper Eq. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import Rho, View
from physic_core.engine.joint.visibility import around, masks_of
from physic_core.errors import PhysicError
from physic_core.geometry.visibility import inside_image

__all__ = ["LEAST_DEPTH_M", "DepthSettings", "DepthTerm", "depth_energy", "offset_sigmas"]

LEAST_DEPTH_M = 0.01
"""Depth of a vertex in front of the camera, metres, below which its logarithm is clamped."""

_SIGMA = 0.03  # expected error of the logarithm of depth
_OUTLIER_SIGMAS = 2.0
# A free depth offset leaves only the relief of a person, which networks estimate less reliably than the distance.
_RELIEF_SHARE = 2.0 / 15.0
_EDGE_SHARE = 0.005  # of the person's size: nearer to the silhouette, the depth often belongs to the background


@dataclass(frozen=True)
class DepthSettings:
    """Depth of people's visible surface against the depth map.

    Attributes:
        weight: lambda_d of Eq. 5; 0 removes the term.
        offset_sigma: expected log(depth offset) between person and scene, for people whose feet stand on a known
            floor; 0 fixes their depth to the scene.
        offset_alone_sigma: expected log(depth offset) of all other people.
    """

    weight: NotNegative = 15.0
    offset_sigma: NotNegative = 0.2
    offset_alone_sigma: NotNegative = 0.03


def depth_energy(
    z: Tensor, log_seen: Tensor, weight: Tensor, log_scale: Tensor, offset: Tensor, sigma: float, rho: Rho
) -> Tensor:
    """L_d (Eq. 4) per pixel: ``mean_v rho((log z_v - log(s d_v) - o)^2 / sigma^2)``, independent of the resolution.

    Args:
        z: (B, V) depth of the vertices, metres.
        log_seen: (B, V) logarithm of the depth map at their pixels, finite.
        weight: (B, V), 0 for vertices without a depth.
        log_scale: () of the scene; the depth map scales with it.
        offset: (B,) log of the ratio between the depth map at the person and the scene's depth.
        sigma: expected difference between the logarithms.
        rho: robust loss.

    Returns:
        (B,); 0 for a person without such vertices.
    """
    residual = (z.clamp(min=LEAST_DEPTH_M).log() - log_seen - log_scale - offset[:, None]) / sigma
    total = (weight * rho(residual.square())).sum(-1)
    return total / weight.sum(-1).clamp(min=1e-9)


class DepthTerm:
    """Eq. 4 on the logarithm of depth, with each visible vertex compared at its own pixel.

    Args:
        settings: of the term.
        context: constants of this optimisation.
        state: free parameters; people with a free offset count by their relief only.

    Raises:
        PhysicError: the problem has no depth map.
    """

    def __init__(self, settings: DepthSettings, context: JointContext, state: State) -> None:
        if settings.weight and context.problem.human_depth is None:
            raise PhysicError(
                "the depth term compares pixels, but there is no human_depth: give it, or set"
                " engine.joint.depth.weight = 0"
            )
        self._context, self._weight = context, settings.weight
        self._per_person = torch.where(state.offset_free, settings.weight * _RELIEF_SHARE, settings.weight)
        self.active: dict[str, Tensor] = {}
        self.log_seen = torch.zeros_like(context.area)

    def refresh(self, view: View) -> None:
        """Select camera-facing, visible vertices well inside the mask, weighted by their area in pixels."""
        context, visibility = self._context, view.visibility
        self.log_seen, known = _sample(context.log_depth, visibility.uv)
        well_inside = around(visibility.uv, masks_of(context), context.person_px * _EDGE_SHARE).all(0)
        shown = visibility.unobstructed & known & well_inside & visibility.in_play
        # A slanted surface covers fewer pixels.
        rays = torch.nn.functional.normalize(view.vertices, dim=-1)
        slope = -(visibility.normals * rays).sum(-1)
        self.active = {"depth": torch.where(shown, context.area * slope, torch.zeros_like(context.area))}

    def robust_sum(self) -> RobustSum | None:
        """Weights of the differences between logarithms of depth; None where the term is off."""
        if not self._weight:
            return None
        weight = self.active["depth"]
        share = weight / weight.sum(1, keepdim=True).clamp(min=1e-9)
        return RobustSum.of("cauchy", _OUTLIER_SIGMAS, _SIGMA, self._per_person.to(share.dtype)[:, None] * share)


def offset_sigmas(settings: DepthSettings, context: JointContext) -> Tensor:
    """Expected spread of each person's depth offset (B,), 0 where it is fixed to the scene."""
    problem, feet_seen = context.problem, context.feet_seen
    alone = torch.full_like(problem.transl0[:, 2], settings.offset_alone_sigma)
    if context.floor_normal is None:
        return alone
    stands = feet_seen.any(1) if problem.grounded is None else feet_seen.any(1) & problem.grounded
    return torch.where(stands, settings.offset_sigma, alone)


def _sample(log_depth: Tensor | None, uv: Tensor) -> tuple[Tensor, Tensor]:
    """The map at the nearest pixel, 0 where unknown, and whether it is known: (B, n) each."""
    if log_depth is None:
        return torch.zeros_like(uv[..., 0]), torch.zeros_like(uv[..., 0], dtype=torch.bool)
    height, width = log_depth.shape
    inside = inside_image(uv, height, width)
    at = torch.where(inside[..., None], uv, torch.zeros_like(uv)).round().long()
    value = log_depth[at[..., 1], at[..., 0]].to(uv.dtype)
    known = inside & torch.isfinite(value)
    return torch.where(known, value, torch.zeros_like(value)), known
