"""Probability that a vertex touches a surface, from its distance, the kind of surface, visibility and the prior.

A vertex touches if its true signed distance is in the contact interval, from ``inside_m`` inside to ``distance_m``
outside. The measured distance ``d`` differs from it by errors of depth, pose and scale. With probability ``r`` these
errors are Gaussian, with standard deviation ``s``. Otherwise limb or surface are somewhere else, and the distance is
weak evidence:

    p = r (Phi((distance_m - d) / s) - Phi((-inside_m - d) / s)) + (1 - r) b exp(-|d| / 0.3 m)

``r``, ``s`` and ``b`` depend on the surface: the floor is a plane through many points, the visible scene has the errors
of depth, what people hide is inpainted, two people have errors of their own, and parts of one body only those of its
pose. For a limb that the photo does not show, ``r`` is lower and ``s`` larger. A foot that is found to be in the air
keeps a fifth of its probability, an arm that hangs beside the thigh a tenth.

Skin of a round body part faces what it touches (:func:`facing_probability`).

The prior shifts the log-odds of ``p`` by a small amount, since stage 3 has used it already. It is a prior of contact
with the scene, so that contact with skin has none.

The constants of scene and floor are fitted by maximum likelihood on 38 synthetic worlds (``physic bench``, seed 900),
with errors of versions 3 and 4; those of skin on the 30 worlds of ``benchmarks/contact_probability.py``. Those of
lifted feet, hanging arms and assumed supports are set by hand. The benchmark measures the calibration on other worlds.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.settings import ContactSettings

__all__ = [
    "ASSUMED",
    "HIDDEN_SCENE",
    "LIFTED_FOOT",
    "OWN_HAND",
    "PERSON",
    "SELF",
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
    """

    log_odds: float
    sigma_m: float
    unseen_log_odds: float
    share: float
    unseen_share: float


FLOOR = SurfaceError(0.40, 0.004, -1.8, 1.0, 1.0)
"""The floor's plane."""

VISIBLE_SCENE = SurfaceError(0.95, 0.030, -1.25, 1.0, 0.6)
"""Scene points that the photo shows."""

HIDDEN_SCENE = SurfaceError(2.2, 0.026, -1.25, 1.0, 0.6)
"""Inpainted scene points. Stage 3 has moved them out of the bodies, so that they follow the skin."""

PERSON = SurfaceError(-0.41, 0.016, -0.54, 0.143, 0.325)
"""Skin of another person, by distances without the gap that vertices share."""

OWN_HAND = SurfaceError(0.365, 0.033, -2.30, 0.177, 0.111)
"""Skin of the own body, where a hand touches or is touched."""

SELF = SurfaceError(0.10, 0.013, -0.22, 0.018, 0.030)
"""Skin of other parts of the own body, which the errors of arms and legs move less than hands."""

SURFACES = (FLOOR, VISIBLE_SCENE, HIDDEN_SCENE, PERSON, OWN_HAND, SELF)
"""Kinds of surfaces, in the order of the argument ``kind`` of :func:`contact_probability`."""

LIFTED_FOOT = 0.2
"""Factor on the probability of a foot that is found to be in the air."""

HANGING_ARM = 0.1
"""Factor on the probability of an arm that hangs beside the thigh: nearly all are a few centimetres from it."""

ASSUMED = 0.5
"""Probability of contact with an assumed support: the pose needs it, and nothing shows it."""

_FACING = 0.6
"""Cosine at which a surface is touched by half as many vertices as ahead. A limb of radius 5 cm is within 2 cm of a
plane where the cosine is above 0.6, the torso where it is above 0.85; surfaces are rarely planes."""

_FACING_SLOPE = 8.0

_UNSEEN_SIGMA_M = 0.0125  # of a limb that the photo does not show, added in squares
_REACH_M = 0.3
_PRIOR_WEIGHT = 0.157  # of the prior's log-odds
_PRIOR_OFFSET = -0.275
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
    table = distance.new_tensor([(e.log_odds, e.sigma_m, e.unseen_log_odds, e.share, e.unseen_share) for e in SURFACES])
    log_odds, sigma, unseen_log_odds, seen_share, unseen_share = table.T[:, kind]
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
        evidence = _PRIOR_WEIGHT * torch.logit(prior.to(d).clamp(*_PRIOR_RANGE)) + _PRIOR_OFFSET
        p = torch.sigmoid(torch.logit(p) + evidence)
    return torch.where(known, p, torch.zeros_like(p))


def facing_probability(cosine: Tensor) -> Tensor:
    """Return the factor (...) on the probability that skin of a round body part touches a scene or floor.

    Round parts touch with the skin that faces the surface. Hands and feet are so thin that their far side is near, too.

    Args:
        cosine: (...) between the inward normal of the skin and the normal of the surface; NaN where it has none, which
            gives 1.
    """
    return torch.where(torch.isnan(cosine), 1.0, torch.sigmoid(_FACING_SLOPE * (cosine - _FACING)))
