"""Metric depth with a scale of its own, such as a network's or a depth camera's: a witness on the scale of a scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.sizes.evidence import DEPTH_SCALE_SIGMA
from physic_core.engine.sizes.scale_vote import Witnesses

if TYPE_CHECKING:
    from physic_core.engine.sizes.scale_vote import ScaleVote
    from physic_core.types import DepthMap, Intrinsics, Pointmap

_SURE, _SURE_IF_STATED = 0.9, 0.99  # that a metric depth is not wrong, without and with a stated error
_NEAR = 0.3  # standard deviation of the logarithm of depth, of pixels that count as near the people


def depth_witness(depth: DepthMap, scene: Pointmap, camera: Intrinsics, torsos: Witnesses) -> Witnesses | None:
    """Return what a metric depth says of the scale of a relative scene; None if they have no pixel in common.

    It is the median of the ratio of both, in which the pixels near the people count most: an unknown shift of the
    inverse depth makes the ratio another one elsewhere. A depth whose camera is estimated is that of sizes in px, and
    proportional to the focal length.

    Args:
        depth: of the scene.
        scene: relative.
        camera: of the people's bodies.
        torsos: of the people.
    """
    own = scene.points[..., 2].astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        known = scene.valid & (own > 0) & (depth.depth > 0)
        ratio = depth.depth[known] / own[known]
    if not len(ratio):
        return None
    people = (torsos.depth / torsos.scale)[np.isfinite(torsos.scale)]
    weight = np.exp(-0.5 * (np.log(own[known] / np.median(people)) / _NEAR) ** 2) if len(people) else 1.0
    order = np.argsort(ratio)
    total = np.cumsum(np.broadcast_to(weight, ratio.shape)[order] + 1e-9)
    scale = float(ratio[order][np.searchsorted(total, 0.5 * total[-1])])
    if depth.intrinsics is not None and not depth.intrinsics.known:
        scale *= math.sqrt(camera.fx * camera.fy / (depth.intrinsics.fx * depth.intrinsics.fy))
    stated = depth.scale_sigma is not None
    sigma, sure = (depth.scale_sigma, _SURE_IF_STATED) if stated else (DEPTH_SCALE_SIGMA, _SURE)
    return Witnesses(np.array([scale]), np.array([np.nan]), np.array([sigma]), np.array([sure]), 0.0)


def rescaled_depth(depth: DepthMap, witness: Witnesses, vote: ScaleVote, notes: Sequence[str]) -> DepthMap:
    """Return a metric depth at the scale of a vote in which it took part, with notes about the other witnesses."""
    factor = math.exp(-float(vote.residuals(witness)[0]))
    own = f"the metric depth counts beside them, and was multiplied by {factor:.2f}"
    scaled = np.asarray(depth.depth * factor, np.float32)
    return replace(depth, depth=scaled, scale_sigma=vote.scale.sigma, notes=(*depth.notes, *notes, own))
