"""Depth term L_d: depth of visible vertices against the depth map at their pixels (paper Eq. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import Snapshot
from physic_core.engine.joint.visibility import sample_mask_neighbours
from physic_core.errors import PhysicError
from physic_core.geometry.visibility import inside_image
from physic_core.types.bounds import NotNegative

MIN_DEPTH_M = 0.01
"""Smallest depth of a vertex in the logarithm, metres; smaller depths are clamped."""

_SIGMA = 0.03  # expected error of the logarithm of depth
_OUTLIER_SIGMAS = 2.0
# With a free depth offset only the relief of a person counts, which networks estimate less reliably than the distance.
_RELIEF_SHARE = 2.0 / 15.0
_EDGE_SHARE = 0.005  # of the stature in px; nearer to the silhouette, the depth often belongs to the background


@dataclass(frozen=True)
class DepthSettings:
    """Settings of the depth term: depth of visible vertices against the depth map."""

    weight: NotNegative = 15.0
    """Lambda_d of Eq. 5; 0 removes the term."""
    offset_sigma: NotNegative = 0.2
    """Expected log(depth offset) between person and scene, for people whose feet stand on a known floor; 0 fixes their
    depth to the scene."""
    offset_alone_sigma: NotNegative = 0.03
    """Expected log(depth offset) of all other people."""


class DepthTerm:
    """Depth term: Eq. 4 with log depth, between each visible vertex and the depth map at its projection.

    ``mean_v rho((log z_v - log(s d_v) - o)^2 / sigma^2)``, with scale s of the scene and depth offset o of the person.
    The mean does not depend on the resolution.

    Args:
        state: free parameters; people with a free offset have a smaller weight.

    Raises:
        PhysicError: the problem has no depth map.
    """

    def __init__(self, settings: DepthSettings, context: JointContext, state: State) -> None:
        if settings.weight and context.problem.human_depth is None:
            raise PhysicError(
                "the depth term compares pixels, but human_depth is missing: give it, or set"
                " engine.joint.depth.weight = 0"
            )
        self._context, self._weight = context, settings.weight
        self._per_person = torch.where(state.offset_free, settings.weight * _RELIEF_SHARE, settings.weight)
        self.weights: dict[str, Tensor] = {}
        self.log_map_depth = torch.zeros_like(context.area)

    def refresh(self, snapshot: Snapshot) -> None:
        """Select visible vertices away from the mask's border, and weigh them by their area in pixels."""
        context, visibility = self._context, snapshot.visibility
        self.log_map_depth, known = _sample(context.log_depth, visibility.uv)
        edge_px = context.person_px * _EDGE_SHARE
        well_inside = sample_mask_neighbours(visibility.uv, context.problem.masks, edge_px).all(0)
        shown = visibility.unobstructed & known & well_inside & visibility.eligible
        # A slanted surface covers fewer pixels.
        rays = torch.nn.functional.normalize(snapshot.vertices, dim=-1)
        slope = -(visibility.normals * rays).sum(-1)
        self.weights = {"depth": torch.where(shown, context.area * slope, torch.zeros_like(context.area))}

    def robust_sum(self) -> RobustSum | None:
        """Return the robust sum over differences of log depth; None if the term is off."""
        if not self._weight:
            return None
        weight = self.weights["depth"]
        share = weight / weight.sum(1, keepdim=True).clamp(min=1e-9)
        return RobustSum.of("cauchy", _OUTLIER_SIGMAS, _SIGMA, self._per_person.to(share.dtype)[:, None] * share)


def depth_offset_sigmas(settings: DepthSettings, context: JointContext) -> Tensor:
    """Return the expected size of each person's log depth offset to the scene: (B,), 0 for a fixed offset."""
    problem, feet_visible = context.problem, context.feet_visible
    alone = torch.full_like(problem.transl0[:, 2], settings.offset_alone_sigma)
    if problem.floor_normal is None:
        return alone
    on_floor = feet_visible.any(1).to(alone)
    if problem.foot_touch is not None:
        on_floor = on_floor * (1 - (1 - problem.foot_touch.to(alone)).prod(1))
    return torch.lerp(alone, torch.full_like(alone, settings.offset_sigma), on_floor)


def _sample(log_depth: Tensor | None, uv: Tensor) -> tuple[Tensor, Tensor]:
    """Return the map at the nearest pixel, 0 where unknown, and whether it is known: (B, n) each."""
    if log_depth is None:
        return torch.zeros_like(uv[..., 0]), torch.zeros_like(uv[..., 0], dtype=torch.bool)
    height, width = log_depth.shape
    inside = inside_image(uv, height, width)
    at = torch.where(inside[..., None], uv, torch.zeros_like(uv)).round().long()
    value = log_depth[at[..., 1], at[..., 0]].to(uv.dtype)
    known = inside & torch.isfinite(value)
    return torch.where(known, value, torch.zeros_like(value)), known
