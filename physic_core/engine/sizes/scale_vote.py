"""Robust vote of people on the scale of a scene, and on the shift of its inverse depth: by their soles, or torsos.

A scene of depth Z' in its own unit has the metric depth Z with 1 / Z = (1 / Z' + t) / s. A person at depth z, whom the
scene alone would scale by m = z / Z', says s = m + t z. So people at different depths determine t as well: near people
the scale, far ones the shift.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating]

_LEAST_SIZE = 0.25  # of people with visible soles, as a share of the size of the best visible torso
_SHIFTS = np.linspace(-3.0, 3.0, 241)  # tried shifts, in standard deviations


@dataclass(frozen=True)
class ScaleVote:
    """Result of a vote.

    Attributes:
        scale: s, metres per unit.
        shift: t, 1 / unit.
        sigma: standard deviation of log(s): the error that all voters share, and their disagreement.
        outliers: (N,) bool, voters whose scale differs by more than three standard errors.
        split: whether such voters have more than a third of the votes.
    """

    scale: float
    shift: float
    sigma: float
    outliers: NDArray[np.bool_]
    split: bool


@dataclass(frozen=True)
class ScaleRule:
    """How people vote on the scale of a scene.

    Attributes:
        by: "soles" on the floor, "torsos", or "auto": soles where they are seen well, else torsos.
        soles_sigma: unknown part of a scale from soles: stature. Standard deviation of the logarithm.
        torsos_sigma: unknown part of a scale from torsos: stature and the person's depth.
        disagreement: a person whose soles say this many times more or less than their torso stands elsewhere.
    """

    by: Literal["auto", "soles", "torsos"]
    soles_sigma: float
    torsos_sigma: float
    disagreement: float


@dataclass(frozen=True)
class PersonScales:
    """Scale of the scene estimated from each of N people, metres per unit; NaN where unknown.

    Attributes:
        soles: (N,) from soles on the floor.
        torsos: (N,) from the depth of the torso.
        lifted: (N,) bool, people whose feet are over the floor.
    """

    soles: FloatArray
    torsos: FloatArray
    lifted: NDArray[np.bool_]


@dataclass(frozen=True)
class PeopleVote:
    """Scale of a scene by its people.

    Attributes:
        vote: result of the vote.
        by_soles: whether soles voted, or torsos.
        voters: (N,) bool, people whose scale was used.
        elsewhere: (N,) bool, people whose soles are not on the floor.
    """

    vote: ScaleVote
    by_soles: bool
    voters: NDArray[np.bool_]
    elsewhere: NDArray[np.bool_]


def scale_by_people(
    people: PersonScales, depths: FloatArray, weights: FloatArray, shift_sigma: float, rule: ScaleRule
) -> PeopleVote | None:
    """Let soles on the floor vote on the scale, else torsos; None if neither is visible.

    The scale that puts soles on the floor is the better one: the relative depth of a person is often larger than that
    of the floor under their feet.

    Args:
        people: scales of N people.
        depths: (N,) metres.
        weights: (N,) > 0, how well the photo shows each person.
        shift_sigma: standard deviation of the shift of inverse depth, 1 / unit; 0 if it is known.
        rule: of the vote.
    """
    with np.errstate(invalid="ignore"):
        elsewhere = np.abs(np.log(people.soles / people.torsos)) > np.log(rule.disagreement)
    if elsewhere[np.isfinite(people.soles)].all():
        elsewhere[:] = False
    elsewhere |= people.lifted
    soles = np.where(elsewhere, np.nan, people.soles)
    by_soles = rule.by == "soles" or (rule.by == "auto" and _are_seen_well(soles, people.torsos, weights))
    scales, sigma = (soles, rule.soles_sigma) if by_soles else (people.torsos, rule.torsos_sigma)
    if not np.isfinite(scales).any():
        return None
    vote = vote_on_scale(scales, depths, weights, sigma, shift_sigma)
    return PeopleVote(vote, by_soles, np.isfinite(scales) & ~vote.outliers, elsewhere)


def _are_seen_well(soles: FloatArray, torsos: FloatArray, weights: FloatArray) -> bool:
    """Return whether soles are seen of a person who is not much smaller in the photo than the best seen torso."""
    best = weights[np.isfinite(soles)].max(initial=0.0)
    return bool(best > _LEAST_SIZE * weights[np.isfinite(torsos)].max(initial=0.0))


def vote_on_scale(
    scales: FloatArray, depths: FloatArray, weights: FloatArray, sigma: FloatArray | float, shift_sigma: float
) -> ScaleVote:
    """Return the scale and shift with the least robust cost.

    Args:
        scales: (N,) m of each voter, metres per unit; NaN for people who do not vote.
        depths: (N,) z of each voter, metres.
        weights: (N,) > 0, how well the photo shows each voter.
        sigma: standard deviation of log(m), of all or (N,); the most certain voters dominate.
        shift_sigma: standard deviation of the shift, 1 / unit; 0 if it is known.
    """
    voters = np.isfinite(scales)
    sigmas = np.broadcast_to(sigma, len(scales))[voters]
    least = float(sigmas.min())
    m, z, weight = scales[voters], depths[voters], weights[voters] * (least / sigmas) ** 2
    weight = weight / weight.max()
    shifts = _SHIFTS * shift_sigma if shift_sigma and len(m) > 1 else np.zeros(1)
    candidates = np.log(np.maximum(m + shifts[:, None] * z, 1e-3 * m))  # (T, N)
    # Each voter's own scale is a candidate: cost (T, N candidates).
    misses = (candidates[:, None, :] - candidates[:, :, None]) / sigmas
    cost = (np.log1p(misses**2) * weight).sum(-1)
    if len(shifts) > 1:
        cost = cost + ((shifts / shift_sigma) ** 2)[:, None]
    row, best = np.unravel_index(int(cost.argmin()), cost.shape)
    logs = candidates[row]
    middle = float(logs[best])
    for _ in range(20):
        kernel = weight / (1 + ((logs - middle) / sigmas) ** 2)
        middle = float(np.average(logs, weights=kernel))
    share = weight / weight.sum()
    # Mean absolute deviation, as a standard deviation of the mean of so many voters.
    spread = 1.25 * float((share * np.abs(logs - middle)).sum() * np.sqrt((share**2).sum()))
    outliers = np.zeros(len(scales), bool)
    outliers[voters] = np.abs(logs - middle) > 3 * sigmas
    split = float(share[outliers[voters]].sum()) > 1 / 3
    return ScaleVote(float(np.exp(middle)), float(shifts[row]), float(np.hypot(least, spread)), outliers, split)
