"""Probability that a vertex touches a surface, from its distance, the kind of surface, visibility and the prior.

A vertex touches if its true signed distance is in the contact interval, from ``inside_m`` inside to ``distance_m``
outside. The measured distance ``d`` differs from it by errors of depth, pose and scale. With probability ``r`` these
errors are Gaussian, with standard deviation ``s``. Otherwise limb or surface are somewhere else, and the distance is
weak evidence:

    p = r (Phi((distance_m - d) / s) - Phi((-inside_m - d) / s)) + (1 - r) b exp(-|d| / 0.3 m)

``r``, ``s`` and ``b`` depend on the surface: the floor is a plane through many points, the scene has the errors of
depth and of the inpainter, two people have errors of their own, and parts of one body only those of its pose. For a
limb that the photo does not show, ``r`` is lower and ``s`` larger. A foot that is found to be in the air keeps a fifth
of its probability, an arm at the thigh of a straight hip a tenth.

Skin of a round body part faces what it touches (:func:`facing_probability`).

The prior shifts the log-odds of ``p`` by a small amount, since stage 3 has used it already. It is a prior of contact
with the scene, so that contact with skin has none. It tells nothing more about skin near the floor.

The constants of scene, floor and skin are fitted by maximum likelihood with ``benchmarks/contact_probability.py``.
Those of lifted feet, arms at thighs and assumed supports are set by hand. The benchmark measures the calibration on
other worlds.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import torch
from torch import Tensor

from physic_core.engine.settings import ContactSettings

__all__ = [
    "ASSUMED",
    "ASSUMED_HOLD",
    "CARRYING",
    "LIFTED_FOOT",
    "OBJECT",
    "OWN_HAND",
    "PERSON",
    "SCENE",
    "SELF",
    "STRAIGHT_HIP",
    "SURFACES",
    "SurfaceError",
    "contact_probability",
    "facing_probability",
]


@dataclass(frozen=True)
class SurfaceError:
    """Errors of the distance to one kind of surface.

    Attributes:
        log_odds: of ``r``, for limbs that the photo shows.
        sigma_m: ``s`` for these limbs, metres.
        unseen_log_odds: added for limbs that the photo does not show.
        share: ``b`` for limbs that the photo shows.
        unseen_share: ``b`` for the others.
        prior_weight: of the log-odds of the contact prior.
        prior_offset: added to the log-odds with a prior.
    """

    log_odds: float
    sigma_m: float
    unseen_log_odds: float
    share: float
    unseen_share: float
    prior_weight: float = 0.0
    prior_offset: float = 0.0


FLOOR = SurfaceError(3.106, 0.008, -1.389, 0.589, 0.715, 0.0, 1.082)
"""The floor's plane."""

SCENE = SurfaceError(2.302, 0.039, -0.269, 0.461, 0.513, 0.096, -0.665)
"""Scene points, visible or inpainted."""

OBJECT = SurfaceError(0.95, 0.030, -1.25, 1.0, 0.6, 0.16, -0.28)
"""Small objects, of which the photo shows the front. Fitted to visible scene points of 38 synthetic worlds."""

PERSON = SurfaceError(-0.41, 0.016, -0.54, 0.143, 0.325)
"""Skin of another person, by distances without the gap that vertices share."""

OWN_HAND = SurfaceError(0.365, 0.033, -2.30, 0.177, 0.111)
"""Skin of the own body, where a hand touches or is touched."""

SELF = SurfaceError(0.10, 0.013, -0.22, 0.018, 0.030)
"""Skin of other parts of the own body, which the errors of arms and legs move less than hands."""

SURFACES = (FLOOR, SCENE, OBJECT, PERSON, OWN_HAND, SELF)
"""Kinds of surfaces, in the order of the argument ``kind`` of :func:`contact_probability`."""

LIFTED_FOOT = 0.2
"""Factor on the probability of a foot that is found to be in the air."""

STRAIGHT_HIP = 0.1
"""Factor on the probability of an arm at the thigh of a straight hip: nearly all are a few centimetres from it."""

ASSUMED = 0.5
"""Probability of contact with an assumed support: the pose needs it, and nothing shows it."""

ASSUMED_HOLD = 0.8
"""Probability that a hand at an assumed support touches it: 21 of 25 hands in pictures with measured contact. A third
of its vertices do.
"""

CARRYING = 0.9
"""Probability that a part that carries a balanced person touches what it rests on, hands excepted: on synthetic worlds
43 of 48 such parts, without feet, and 7 of 9 on worlds that took no part."""

FACING = 0.41
"""Cosine at which a surface is touched by half as many vertices as ahead; surfaces are rarely planes."""

FACING_SLOPE = 3.63
"""Slope of the log-odds over the cosine."""

_UNSEEN_SIGMA_M = 0.0125  # of a limb that the photo does not show, added in squares
_REACH_M = 0.3
_PRIOR_RANGE = (0.05, 0.95)


def contact_probability(
    distance: Tensor, kind: Tensor, seen: Tensor, prior: Tensor | None, settings: ContactSettings
) -> Tensor:
    """Return the probability of contact (...); 0 beyond the search radius.

    Args:
        distance: (...) signed, metres; inf beyond the search radius.
        kind: (...) int64, index into :data:`SURFACES`.
        seen: (...) bool, vertices of limbs that the photo shows.
        prior: (...) of the contact prior, in [0, 1]; None for contact with skin.
        settings: the contact interval.
    """
    table = distance.new_tensor([astuple(error) for error in SURFACES]).T[:, kind]
    log_odds, sigma, unseen_log_odds, seen_share, unseen_share, prior_weight, prior_offset = table
    unseen = (~seen).to(distance)
    sigma = torch.sqrt(sigma.square() + unseen * _UNSEEN_SIGMA_M**2)
    right = torch.sigmoid(log_odds + unseen * unseen_log_odds)
    known = torch.isfinite(distance)
    d = torch.where(known, distance, torch.zeros_like(distance))
    outer, inner = (torch.special.ndtr((bound - d) / sigma) for bound in (settings.distance_m, -settings.inside_m))
    share = torch.where(seen, seen_share, unseen_share)
    p = right * (outer - inner) + (1 - right) * share * torch.exp(-d.abs() / _REACH_M)
    p = p.clamp(1e-6, 1 - 1e-6)
    if prior is not None:
        p = torch.sigmoid(torch.logit(p) + prior_weight * torch.logit(prior.to(d).clamp(*_PRIOR_RANGE)) + prior_offset)
    return torch.where(known, p, torch.zeros_like(p))


def facing_probability(cosine: Tensor) -> Tensor:
    """Return the factor (...) on the probability that skin of a round body part touches a scene or floor.

    Round parts touch with the skin that faces the surface. Hands and feet are so thin that their far side is near, too.

    Args:
        cosine: (...) between the inward normal of the skin and the normal of the surface; NaN where it has none, which
            gives 1.
    """
    return torch.where(torch.isnan(cosine), 1.0, torch.sigmoid(FACING_SLOPE * (cosine - FACING)))
