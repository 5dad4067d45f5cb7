"""Size of people in a scene: by the floor under their soles, and by their points. Camera frame, metres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.sizes.evidence import FACTOR_SPREAD

if TYPE_CHECKING:
    from physic_core.types import FloatArray


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


def size_beside_others(before: FloatArray, after: FloatArray, sigma: FloatArray, person: int) -> tuple[float, float]:
    """Return the log size of a person as the photo shows it beside the others, and its standard deviation.

    The joint fit divides a contradiction between all people. So the photo shows a person as large as the result, less
    the growth of the others, weighed by their errors.

    Args:
        before: (N,) log sizes before the fit.
        after: (N,) log sizes by the fit, NaN where unknown.
        sigma: (N,) expected errors of ``before``.
        person: row.
    """
    weight = np.delete(np.where(np.isfinite(after), 1 / (sigma**2 + FACTOR_SPREAD**2), 0.0), person)
    spread = sigma[person] ** 2 + FACTOR_SPREAD**2
    if not weight.sum():
        return float(after[person]), float(np.sqrt(spread))
    common = np.average(np.delete(np.nan_to_num(after - before), person), weights=weight)
    return float(after[person] - common), float(np.sqrt(spread + 1 / weight.sum()))
