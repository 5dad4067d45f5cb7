"""Sole term: height of soles above the floor, for soles near the floor."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.distances import lowest_height
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import RobustLoss, Snapshot
from physic_core.geometry.robust import robust_loss
from physic_core.types.bounds import NotNegative

_SIGMA_M, _OUTLIER_SIGMAS = 0.015, 2.0  # a foot more than about 3 cm over the floor is an outlier
_LOWER_SIGMA_M, _LOWER_OUTLIER_SIGMAS = 0.04, 2.0
_LOWER_WEIGHT = 2.0  # of the lower visible foot, in weights of each foot
_MAX_LOWER_HEIGHT_M = 0.4  # a lower foot at a larger height is skipped
_UNSEEN_SIGMA_M, _UNSEEN_OUTLIER_SIGMAS = 0.05, 3.0
_MAX_UNSEEN_SIGMAS = 4.0  # an invisible foot at a larger height is skipped


@dataclass(frozen=True)
class SoleSettings:
    """Settings of the sole term: mean height above the floor of the lowest 5 % of a sole's vertices."""

    weight: NotNegative = 2.0
    """Weight of each visible foot near the floor; the lower one has twice as much again, up to a larger height."""
    unseen_weight: NotNegative = 4.0
    """Weight of each invisible foot; most feet stand on the floor."""


def sole_energy(lowest: Tensor, weight: Tensor, lower_weight: Tensor, near: RobustLoss, far: RobustLoss) -> Tensor:
    """Return the sole energy (B,): ``sum_f w_f near(h_f^2) + w far(min_f h_f^2)`` with robust losses near and far.

    ``near`` redescends within centimetres, so that a foot in the air gets no gradient. ``far`` does not redescend. It
    applies only to the lower foot: a person who stands, walks or runs has at most one foot far from the ground.

    Args:
        lowest: (B, 2) height of the left and the right sole, metres.
        weight: (B, 2), 0 for an invisible foot.
        lower_weight: (B,), 0 for people who may float (invisible feet, or no expected contact).
        near: robust loss of squared metres.
        far: robust loss of squared metres.
    """
    seen = weight > 0
    lower = torch.where(seen, lowest, torch.full_like(lowest, torch.inf)).amin(-1)
    # Invisible feet may have infinite height: mask them, since 0 * inf is NaN.
    lower = torch.where(seen.any(-1), lower, torch.zeros_like(lower))
    lowest = torch.where(seen, lowest, torch.zeros_like(lowest))
    return (weight * near(lowest.square())).sum(-1) + lower_weight * far(lower.square())


class SoleTerm:
    """Sole term, evaluated by :class:`physic_core.engine.joint.terms.surface.SurfaceTerms`."""

    def __init__(self, settings: SoleSettings, context: JointContext) -> None:
        self.settings, self._context = settings, context
        self._all_seen = bool(context.feet_visible.all())
        self.weights: dict[str, Tensor] = {}

    @property
    def is_on(self) -> bool:
        """Whether the sole term is used: there is a floor, and at least one weight of the term is not 0."""
        s = self.settings
        return self._context.problem.floor_normal is not None and bool(s.weight or s.unseen_weight)

    def refresh(self, snapshot: Snapshot) -> None:
        """Weigh the visible feet by their touch, and select people whose lower foot is expected to touch the floor."""
        context, contacts = self._context, snapshot.contacts
        far = torch.full_like(context.area[:, 0], torch.inf)
        heights = [contacts.height[:, rows] for rows in context.soles]
        lowest = torch.stack([lowest_height(h) if h.shape[1] else far for h in heights], 1)
        on_floor = context.feet_visible & torch.isfinite(lowest)
        likely = torch.stack([context.is_contact[:, rows].any(1) for rows in context.soles], 1)
        lower = torch.where(on_floor, lowest, torch.full_like(lowest, torch.inf)).amin(1)
        pulled = (on_floor & likely).any(1) & (lower.abs() < _MAX_LOWER_HEIGHT_M)
        unseen = ~context.feet_visible & (lowest.abs() < _MAX_UNSEEN_SIGMAS * _UNSEEN_SIGMA_M)
        dtype = context.area.dtype
        touch, either = torch.ones_like(lowest), torch.ones_like(lowest[:, 0])
        if context.problem.foot_touch is not None:
            touch = context.problem.foot_touch.to(lowest)
            either = 1 - (1 - touch).prod(1)
        self.weights = {
            "soles": touch * on_floor,
            "lower_sole": either * pulled,
            "unseen_soles": unseen.to(dtype),
        }

    def energy(self, lowest: Tensor) -> Tensor:
        """Return the sole energy (B,) for the heights (B, 2) of the left and the right sole, metres."""
        s = self.settings

        def near(squared: Tensor) -> Tensor:
            return robust_loss("geman_mcclure", squared / _SIGMA_M**2, _OUTLIER_SIGMAS)

        def far(squared: Tensor) -> Tensor:
            return robust_loss("cauchy", squared / _LOWER_SIGMA_M**2, _LOWER_OUTLIER_SIGMAS)

        weight, lower_weight = s.weight * self.weights["soles"], _LOWER_WEIGHT * s.weight * self.weights["lower_sole"]
        seen = sole_energy(lowest, weight, lower_weight, near, far)
        if self._all_seen:
            return seen
        unseen = robust_loss("geman_mcclure", (lowest / _UNSEEN_SIGMA_M).square(), _UNSEEN_OUTLIER_SIGMAS)
        return seen + s.unseen_weight * (self.weights["unseen_soles"] * unseen).sum(1)
