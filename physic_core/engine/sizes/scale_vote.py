"""One vote on the scale of a scene, and on the shift of its inverse depth, by everything of known
size.

A scene of depth Z' in its own unit has the metric depth Z with 1 / Z = (1 / Z' + t) / s. A person
at depth z, who gives the scale m = z / Z' if t = 0, gives s = m + t z. So people at different
depths determine t as well: near people the scale, far ones the shift.

Witnesses of one kind share an error: soles that of the floor, torsos that of the depth of people in
the map. Each one may also be wrong, as a child or a raised foot is. All is evaluated on a fixed
grid of log s and t, for each candidate for the floor, and the answer is the mean over all of them.
So no evidence near a limit switches the answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import DepthMap, SceneScale

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics, Pointmap

_STEP = 0.01
_LOGS = np.arange(math.log(1e-2), math.log(1e3), _STEP)
_SHIFTS = np.linspace(-3.0, 3.0, 31)  # in standard deviations
_WRONG_SIGMA = 0.5  # of the logarithm of the scale by a wrong witness
_LEAST_DENSITY = 1 / float(_LOGS[-1] - _LOGS[0])  # of a wrong witness, which may state any scale
# Sigma of the scale's logarithm if the quantity that all witnesses of a kind share is wrong.
_SHARED_WRONG_SIGMA = 1.0
_SIGMA_SHARE = 0.683  # of the probability within one standard deviation
_SIGMA_DECIMALS = 6  # the last bits are those of a CPU's exponential function
_FARTHEST_M = 1e4


@dataclass(frozen=True)
class Witnesses:
    """N witnesses of one kind on the scale of a scene.

    Attributes:
        scale: (N,) m, metres per unit of the scene; NaN for a witness without a statement.
        depth: (N,) z, metres; NaN if the shift does not matter.
        sigma: (N,) standard deviation of log(m), without the shared error.
        right_probability: (N,) probability that a witness is not wrong.
        shared_sigma: standard deviation of the error that all share.
        shared_wrong: probability that the quantity that all share is wrong, such as the depth of
            people in the map.
    """

    scale: FloatArray
    depth: FloatArray
    sigma: FloatArray
    right_probability: FloatArray
    shared_sigma: float
    shared_wrong: float = 0.0

    @classmethod
    def single(cls, scale: float, sigma: float, right_probability: float) -> Witnesses:
        """Return one witness, whose depth does not matter."""
        m, unknown, error, probability = np.array(
            [[scale], [math.nan], [sigma], [right_probability]]
        )
        return cls(m, unknown, error, probability, 0.0)


@dataclass(frozen=True)
class ScaleVote:
    """Result of a vote with P candidates for the floor.

    Attributes:
        scale: the answer.
        weights: (P,) probability of each candidate.
        log_scale: logarithm of the scale of a person at the reference depth.
        reference: that depth, metres.
    """

    scale: SceneScale
    weights: FloatArray
    log_scale: float
    reference: float

    def residuals(self, witnesses: Witnesses) -> FloatArray:
        """Return log(stated scale / answer) of witnesses: (N,), NaN for a witness without a
        statement.
        """
        m = witnesses.scale + self.scale.shift * np.nan_to_num(witnesses.depth - self.reference)
        return np.asarray(np.log(np.maximum(m, 1e-3 * witnesses.scale)) - self.log_scale)

    def right_probability(self, witnesses: Witnesses) -> FloatArray:
        """Return the probability (N,) that witnesses are right; NaN for a witness without a
        statement.
        """
        away = self.residuals(witnesses)
        sigma = np.hypot(np.hypot(witnesses.sigma, witnesses.shared_sigma), self.scale.sigma or 0.0)
        right, wrong = (
            np.exp(-0.5 * (away / s) ** 2) / s for s in (sigma, np.hypot(_WRONG_SIGMA, sigma))
        )
        sure = witnesses.right_probability
        return sure * right / (sure * right + (1 - sure) * wrong + 1e-300)


def vote_on_scale(
    kinds: Sequence[Witnesses],
    on_planes: Sequence[Sequence[Witnesses]] = ((),),
    log_prior: Sequence[float] = (0.0,),
    shift_sigma: float = 0.0,
) -> ScaleVote | None:
    """Return the posterior of the scale and of the floor; None without a statement of a witness.

    Args:
        kinds: witnesses that do not depend on the floor.
        on_planes: kinds of witnesses that depend on the floor, for each of its P candidates.
        log_prior: (P,) of the candidates, nats.
        shift_sigma: standard deviation of the shift of inverse depth, 1 / unit; 0 if it is known.
    """
    everyone = [w for kind in (kinds, *on_planes) for w in kind]
    depths = np.concatenate([np.zeros(0), *(w.depth[np.isfinite(w.scale)] for w in everyone)])
    if not len(depths):
        return None
    depths = depths[np.isfinite(depths)]
    reference = float(np.median(depths)) if len(depths) else 0.0
    shifts = (
        _SHIFTS * shift_sigma if shift_sigma and len(depths) and np.ptp(depths) > 0 else np.zeros(1)
    )
    shared = sum(
        (_log_likelihood(w, shifts, reference) for w in kinds), np.zeros((len(shifts), len(_LOGS)))
    )
    if len(shifts) > 1:
        shared = shared - 0.5 * (shifts / shift_sigma)[:, None] ** 2
    log_density = np.stack(
        [
            prior + shared + sum(_log_likelihood(w, shifts, reference) for w in plane)
            for prior, plane in zip(log_prior, on_planes, strict=True)
        ]
    )
    return _vote_of_density(log_density, shifts, reference)


def _vote_of_density(log_density: FloatArray, shifts: FloatArray, reference: float) -> ScaleVote:
    """Return the means of a density (P, T, S) of candidates for the floor, shifts (T,) and the grid
    of log scales of a person at the reference depth.
    """
    density = np.exp(log_density - log_density.max())
    density /= density.sum()
    of_log = density.sum((0, 1))
    mean = float(of_log @ _LOGS)
    shift = float(density.sum((0, 2)) @ shifts)
    half = (1 - _SIGMA_SHARE) / 2
    low, high = np.interp([half, 1 - half], of_log.cumsum(), _LOGS)
    sigma = round(float(high - low) / 2, _SIGMA_DECIMALS)
    scale = SceneScale(math.exp(mean) + shift * reference, shift, sigma)
    return ScaleVote(scale, density.sum((1, 2)), mean, reference)


def _log_likelihood(witnesses: Witnesses, shifts: FloatArray, reference: float) -> FloatArray:
    """Return the log likelihood (T, S) of shifts (T,) and the grid of log scales of a person at the
    reference depth.
    """
    is_known = np.isfinite(witnesses.scale)
    m, z, sigma, sure = (
        x[is_known]
        for x in (witnesses.scale, witnesses.depth, witnesses.sigma, witnesses.right_probability)
    )
    logs = np.log(np.maximum(m + shifts[:, None] * np.nan_to_num(z - reference), 1e-3 * m))
    away = logs[..., None] - _LOGS
    sigma = np.hypot(sigma, _STEP)
    right, wrong = (
        np.exp(-0.5 * (away / s[:, None]) ** 2) / (math.sqrt(2 * math.pi) * s[:, None])
        for s in (sigma, np.full_like(sigma, _WRONG_SIGMA))
    )
    each = np.log(
        sure[:, None] * right + (1 - sure)[:, None] * np.maximum(wrong, _LEAST_DENSITY) + 1e-300
    )
    total = each.sum(1)
    maximum = total.max()
    shares = [
        (1 - witnesses.shared_wrong, witnesses.shared_sigma),
        (witnesses.shared_wrong, _SHARED_WRONG_SIGMA),
    ]
    density = np.exp(total - maximum)
    smooth = sum(share * _convolved(density, sigma) for share, sigma in shares if share)
    return np.asarray(np.log(smooth + 1e-300) + maximum)


def _convolved(density: FloatArray, shared_sigma: float) -> FloatArray:
    """Return the density (T, S) over the grid of log scales if its witnesses share a normal
    error.
    """
    import cv2

    return np.asarray(
        cv2.GaussianBlur(
            density,
            (2 * round(5 * shared_sigma / _STEP) + 1, 1),
            max(shared_sigma / _STEP, 1e-3),
            borderType=cv2.BORDER_REFLECT,
        )
    )


def scaled_depth(scene: Pointmap, scale: SceneScale, camera: Intrinsics | None) -> DepthMap:
    """Return the metric depth of a relative scene; ``camera`` is used if the scene does not state
    its own.
    """
    with np.errstate(divide="ignore"):
        inverse = (
            1 / np.where(scene.valid, scene.points[..., 2], np.nan) + scale.shift
        ) / scale.scale
        depth = np.where(inverse > 1 / _FARTHEST_M, 1 / inverse, np.nan).astype(np.float32)
    return DepthMap(depth, scene.intrinsics or camera, scale.sigma, scale.notes)
