"""Size of people in a scene: by the floor under their soles, and by their points. Camera frame, metres."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physic_core.engine.sizes.stature import STATURE_SIGMA

_CERTAIN = 0.2  # log factor beyond which a person is not an adult of the prior, such as a child
FACTOR_SPREAD = 0.05
"""Standard deviation of the logarithm of one size in the photo by another."""
CONTRADICTION = 3 * FACTOR_SPREAD
"""Difference of logarithms beyond which the photo contradicts a given size: three standard errors."""
STATURES_M = (0.5, 2.2)
"""Limits of the stature of people whose size follows from the scene."""


def size_by_scene(
    vertices: Tensor,
    soles: Tensor,
    on_floor: Sequence[bool],
    floor: tuple[Tensor, float] | None,
    points: Sequence[Tensor],
) -> Tensor:
    """Return the factor (B,) by which people must be enlarged to stand in the scene as the photo shows them.

    The photo shows the direction of each body, so that its size follows from its depth: that of the floor under visible
    soles, else that of the person's points. Points of people are too far away by a common share, which the people on
    the floor show. NaN where nothing is known.

    Args:
        vertices: (B, V, 3), each body where the photo shows it.
        soles: (S,) int64, vertices of the soles.
        on_floor: of B people, whether the soles are seen on the floor.
        floor: unit normal (3,) and offset.
        points: of B people, (n, 3) each.
    """
    by_floor, by_points = (torch.full_like(vertices[:, 0, 0], torch.nan) for _ in range(2))
    for i, body in enumerate(vertices):
        if floor is not None and on_floor[i]:
            normal, offset = floor
            drop = -(body[soles] @ normal.to(body)).amin()
            by_floor[i] = offset / drop if bool(drop > 0) else torch.nan
        if len(points[i]):
            by_points[i] = points[i][:, 2].median().to(body) / body[:, 2].median()
    too_far = (by_points / by_floor).nanmedian().nan_to_num(nan=1.0)
    return torch.where(torch.isfinite(by_floor), by_floor, by_points / too_far)


def stature_factor(measured: Tensor, stature: Tensor) -> Tensor:
    """Return the factor (B,) on the estimated statures of people in a scene of known scale.

    The estimate is a prior of adults, and the scene measures each person with an error. Both are combined by their
    spreads, unless they differ so much that the prior cannot hold.

    Args:
        measured: (B,) factor on the size of each person by the scene, NaN where unknown.
        stature: (B,) metres, estimated.
    """
    log = torch.nan_to_num(measured, nan=1.0).log()
    trust = STATURE_SIGMA**2 / (STATURE_SIGMA**2 + FACTOR_SPREAD**2)
    share = 1 - (1 - trust) * torch.exp(-(log / _CERTAIN).square())
    least, most = (limit / stature for limit in STATURES_M)
    return (log * share).exp().clamp(least.clamp(max=1.0), most.clamp(min=1.0))
