"""Stature of people: how tall they are at an age, and how their expected height constrains the
scale of the scene.

Scene scale s and stature h are two measurements of one unknown, since a photo shows only relative
sizes. If they disagree by d, the energy ``(log s)^2 / sigma_s^2 + (log h)^2 / sigma_h^2`` under
``log h - log s = d`` divides d between them. The scene's share is ``sigma_s^2 / (sigma_s^2 +
sigma_h^2)``.

Statures and shapes of children are fitted to Anny's calibrated distribution
(``NOTICE-embedded.md``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from physic_core.body.bones import pose_from_parameters
from physic_core.body.model import BodyModel
from physic_core.engine.sizes.evidence import FACTOR_SPREAD, KNOWN_SIZE_SIGMA
from physic_core.types.known_sizes import size_option
from physic_core.types.observations import LEAST_PROBABILITY

if TYPE_CHECKING:
    from physic_core.types import Bodies, FloatArray
    from physic_core.types.known_sizes import KnownPeople

ADULT_STATURE_M = 1.715 + 0.025
"""Mean height of adults in shoes, metres.

Barefoot adults in high-income countries measure 1.78 m (men) and 1.65 m (women) in the mean
(NCD-RisC, eLife 2016;5:e13410), that is 1.715 m, with a standard deviation of 9.3 cm (ANSUR II,
Gordon et al. 2014). The soles of shoes are the soles of a fitted body: 2.5 cm more.
"""

STATURE_SIGMA = 0.06
"""Expected error of log(stature).

With the embedded body's shape prior (0.054) the combined error is 0.04.
"""

CHILD_SHARE = 0.07
"""Share of children from 2 to 13 years among people whose age is unknown: by eye 22 of 325 people
in 150 photos of the street, sport and rooms.
"""


_CHILD_YEARS = (2.0, 13.0)

STATURES_M = (0.5, 2.2)
"""Limits of the stature of people whose size follows from the scene."""

ADULT_YEARS = 16.0
"""Age from which the body estimator's prior of adults holds."""

_LEAST_STANDING_M = 0.7  # stature of people of one year, who begin to stand

_CERTAIN = 0.2  # log factor beyond which a person is not an adult of the prior, such as a child
_NEWTON_STEPS = 4  # stature is piecewise linear in the shape


@dataclass(frozen=True)
class ChildGrowth:
    """Children from birth to :data:`ADULT_YEARS` in C classes of age.

    Attributes:
        years: (C, 2) limits of each class.
        log_stature: (C,) mean of the logarithm of stature in metres.
        sigma: (C,) standard deviation of it.
        shape: (D, K) polynomial of log stature that gives the mean betas of the embedded body,
            constant term first.
    """

    years: FloatArray
    log_stature: FloatArray
    sigma: FloatArray
    shape: FloatArray

    def at_age(self, years: float) -> tuple[float, float]:
        """Return mean and standard deviation of log stature at an age below :data:`ADULT_YEARS`."""
        middle = self.years.mean(1)
        mean, sigma = (
            np.interp(years, middle, values) for values in (self.log_stature, self.sigma)
        )
        return float(mean), float(sigma)

    def betas(self, log_stature: FloatArray) -> FloatArray:
        """Return the mean betas (N, K) of children with the logarithms (N,) of stature."""
        return np.polynomial.polynomial.polyval(np.asarray(log_stature), self.shape).T


@cache
def load_child_growth() -> ChildGrowth:
    """Return the fitted classes of age."""
    fitted = json.loads((files("physic_core.body") / "ages.json").read_text(encoding="utf-8"))
    stature = np.array([row["log_stature"] for row in fitted["classes"]])
    return ChildGrowth(
        years=np.array([row["years"] for row in fitted["classes"]], np.float64),
        log_stature=stature[:, 0],
        sigma=stature[:, 1],
        shape=np.array(fitted["betas_by_log_stature"]),
    )


@dataclass(frozen=True)
class LinearStature:
    """Standing height as a linear function of betas, valid while the top and bottom vertices do not
    change.

    Attributes:
        height: (B,) metres, at ``betas``.
        slope: (B, K) derivative by betas.
        betas: (B, K) of the linearisation.
    """

    height: Tensor
    slope: Tensor
    betas: Tensor

    def __call__(self, betas: Tensor) -> Tensor:
        """Return the height (B,), metres, of betas (B, K)."""
        return self.height + (self.slope * (betas - self.betas)).sum(-1)


def linearise_stature(model: BodyModel, betas: Tensor) -> LinearStature:
    """Linearise the standing height at betas (B, K)."""
    with torch.enable_grad():
        start = betas.detach().clone().requires_grad_()
        height = model.stature(start)
        (slope,) = torch.autograd.grad(height.sum(), start)
    return LinearStature(height.detach(), slope, betas.detach())


def mean_adult_betas(mean_stature: float, slope: Tensor) -> Tensor:
    """Return the most probable betas (K,) of a body of :data:`ADULT_STATURE_M`.

    Args:
        mean_stature: of zero betas, metres.
        slope: (K,) metres that one unit of each component adds.
    """
    return slope * (ADULT_STATURE_M - mean_stature) / slope.square().sum()


def stature_prior(height: Tensor, expected: Tensor, sigma: float = STATURE_SIGMA) -> Tensor:
    """Return the prior energy ``(log h - log h0)^2 / sigma^2`` (B,) of heights (B,), metres."""
    return ((height.clamp(min=0.1) / expected).log() / sigma).square()


def stature_sigmas(stature: FloatArray, years: FloatArray) -> FloatArray:
    """Return the expected error (N,) of log(stature) of people, some of known stature or age.

    Args:
        stature: (N,) metres, NaN where unknown.
        years: (N,), NaN where unknown.
    """
    growth = load_child_growth()
    sigma = np.array(
        [growth.at_age(age)[1] if age < ADULT_YEARS else STATURE_SIGMA for age in years]
    )
    sigma[np.isfinite(stature)] = 0.0
    return sigma


def adult_probability(stature: FloatArray, years: FloatArray, child: FloatArray) -> FloatArray:
    """Return the probability (N,) that people of unknown age are adults; 1 for a known size or
    age.

    Args:
        stature: (N,) metres, NaN where unknown.
        years: (N,), NaN where unknown.
        child: (N,) probability by the photo, NaN where it says nothing.
    """
    adult = 1 - np.where(np.isnan(child), CHILD_SHARE, child)
    return np.where(np.isnan(stature) & np.isnan(years), adult, 1.0)


def log_stature_of_children() -> tuple[float, float]:
    """Return mean and standard deviation of log stature of children whose age is unknown."""
    growth = load_child_growth()
    child = (growth.years[:, 0] >= _CHILD_YEARS[0]) & (growth.years[:, 1] <= _CHILD_YEARS[1])
    mean = growth.log_stature[child].mean()
    variance = ((growth.log_stature[child] - mean) ** 2 + growth.sigma[child] ** 2).mean()
    return float(mean), float(np.sqrt(variance))


def stature_surprise(stature: float, child: float, *, stands: bool, is_given: bool) -> float:
    """Return by how many standard deviations a stature differs from that of adults or children,
    whichever is likelier.

    A class that is rare by the photo counts as far away as a value of a normal distribution that is
    as rare. Nobody stands before their first birthday.

    Args:
        stature: metres.
        child: probability by the photo, NaN where it says nothing.
        stands: whether the person stands.
        is_given: whether the user states it, perhaps by an age: babies may stand on somebody's lap.
    """
    share = CHILD_SHARE if np.isnan(child) else child
    mean, spread = log_stature_of_children()
    adults = np.log(ADULT_STATURE_M), np.hypot(STATURE_SIGMA, FACTOR_SPREAD)
    if is_given:
        mean = min(mean, float(np.log(stature)))
    elif stands and stature < _LEAST_STANDING_M:
        mean = np.inf
    squares = [
        ((np.log(stature) - middle) / sigma) ** 2 - 2 * np.log(max(part, 1e-9))
        for part, (middle, sigma) in ((1 - share, adults), (share, (mean, spread)))
    ]
    return float(np.sqrt(min(squares)))


def stature_surprise_at_age(stature: float, years: float) -> float:
    """Return by how many standard deviations a stature, metres, differs from that of an age."""
    mean, sigma = float(np.log(ADULT_STATURE_M)), float(np.hypot(STATURE_SIGMA, FACTOR_SPREAD))
    if years < ADULT_YEARS:
        mean, sigma = load_child_growth().at_age(years)
    return abs(float(np.log(stature)) - mean) / sigma


def size_sigmas(
    stature: FloatArray,
    years: FloatArray,
    child: FloatArray,
    scale_sigma: float | None = None,
) -> FloatArray:
    """Return the standard deviation (N,) of the log size of the bodies of N people, children among
    them.

    Args:
        stature: (N,) metres, NaN where unknown.
        years: (N,), NaN where unknown.
        child: (N,) probability by the photo, NaN where it says nothing.
        scale_sigma: of a scene of known size, which gives those of people of unknown stature; None
            if people give it.
    """
    adult = adult_probability(stature, years, child)
    mean, spread = log_stature_of_children()
    other = (mean - np.log(ADULT_STATURE_M)) ** 2  # of who gets the size of the other class
    is_child = 1 - adult >= LEAST_PROBABILITY
    as_adult = stature_sigmas(stature, years) ** 2 + other * is_child
    as_child = spread**2 + other * ~is_child
    sigma = np.sqrt(adult * as_adult + (1 - adult) * as_child)
    if scale_sigma is not None:
        sigma = np.minimum(sigma, np.hypot(scale_sigma, FACTOR_SPREAD))
    return np.asarray(np.maximum(sigma, KNOWN_SIZE_SIGMA))


def stature_factor(measured: Tensor, stature: Tensor) -> Tensor:
    """Return the factor (B,) on the estimated statures of people in a scene of known scale.

    The estimate is a prior of adults, and the scene measures each person with an error. Both are
    combined by their spreads, unless they differ so much that the prior cannot hold.

    Args:
        measured: (B,) factor on the size of each person by the scene, NaN where unknown.
        stature: (B,) metres, estimated.
    """
    log = torch.nan_to_num(measured, nan=1.0).log()
    trust = STATURE_SIGMA**2 / (STATURE_SIGMA**2 + FACTOR_SPREAD**2)
    share = 1 - (1 - trust) * torch.exp(-(log / _CERTAIN).square())
    least, most = (limit / stature for limit in STATURES_M)
    return (log * share).exp().clamp(least.clamp(max=1.0), most.clamp(min=1.0))


def betas_with_stature(model: BodyModel, betas: Tensor, stature: Tensor) -> Tensor:
    """Return the most probable betas (B, K) near the given ones with the given statures (B,),
    metres.

    Shape components have unit variance, so these are the nearest ones. NaN statures change nothing.
    """
    for _ in range(_NEWTON_STEPS):
        linear = linearise_stature(model, betas)
        missing = torch.nan_to_num(stature - linear.height)
        betas = (
            betas
            + linear.slope * (missing / linear.slope.square().sum(-1).clamp(min=1e-9))[:, None]
        )
    return betas


def resize_bodies(
    model: BodyModel,
    rotations: Tensor,
    betas: Tensor,
    transl: Tensor,
    stature: Tensor,
    near_betas: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return betas (B, K) and transl (B, 3) of bodies with other statures (B,) and the factor (B,)
    on their size.

    The pelvis moves along its ray by this factor. The new betas are the nearest to ``near_betas``
    (B, K), or to the old ones.
    """
    taller = betas_with_stature(model, betas if near_betas is None else near_betas, stature)
    ratio = model.stature(taller) / model.stature(betas)
    before = model(rotations, betas, transl, joints_only=True).joints[:, 0]
    after = model(rotations, taller, transl, joints_only=True).joints[:, 0]
    return taller, transl + before * ratio[:, None] - after, ratio


def bodies_of_stature(
    bodies: Bodies, model: BodyModel, statures: FloatArray, near_betas: FloatArray | None = None
) -> Bodies:
    """Give N bodies of the configured body model their known statures (N,), and keep their size in
    the image.

    A body that becomes larger moves away from the camera by the same factor. Its betas are the
    nearest to ``near_betas`` (N, K), or to the old ones.
    """
    parameters = bodies.parameters
    chosen = (
        np.isfinite(statures)
        & np.isfinite(parameters.betas).all(1)
        & np.isfinite(parameters.transl).all(1)
    )
    if not chosen.any():
        return bodies
    rows = parameters[chosen]
    rotations, betas, transl, _ = (each.double() for each in pose_from_parameters(rows))
    wanted = torch.from_numpy(statures[chosen])
    start = betas if near_betas is None else torch.from_numpy(near_betas[chosen])
    resized = resize_bodies(model.double, rotations, betas, transl, wanted, start)
    taller, moved, ratio = (each.numpy() for each in resized)

    def changed(values: FloatArray, new: FloatArray) -> FloatArray:
        out = np.array(values)
        out[chosen] = new
        return out

    factor = changed(np.ones(len(statures)), ratio)[:, None, None]
    return replace(
        bodies,
        parameters=replace(
            parameters,
            betas=changed(parameters.betas, taller),
            transl=changed(parameters.transl, moved),
        ),
        joints=None
        if bodies.joints is None
        else np.asarray(bodies.joints * factor, bodies.joints.dtype),
        mesh=None
        if bodies.mesh is None
        else replace(
            bodies.mesh,
            vertices=np.asarray(bodies.mesh.vertices * factor, bodies.mesh.vertices.dtype),
        ),
    )


def resize_children(
    bodies: Bodies, model: BodyModel, known: KnownPeople, child: FloatArray
) -> tuple[Bodies, list[str]]:
    """Give people of known age under 16, and those who seem to be children, a child's stature and
    shape; others are unchanged.

    Body estimators treat all people as adults, so children come out as adults farther away. The
    size of a child in the photo is preserved. A known stature overrides an age, and both override
    what the photo says.

    Args:
        bodies: of N people, of the configured body model; people of known stature have it.
        model: the configured body model.
        known: by the user.
        child: (N,) probability by the photo, NaN where it says nothing.

    Returns:
        The bodies, and a note about each child.
    """
    betas = np.array(bodies.parameters.betas, np.float64)
    statures = np.full(len(betas), np.nan)
    notes = []
    table = load_child_growth()
    has_body = np.isfinite(betas).all(1)
    known_statures, years = known.filled(len(betas))
    for i in np.flatnonzero((years < ADULT_YEARS) & has_body).tolist():
        mean, sigma = table.at_age(years[i])
        statures[i] = np.exp(mean)
        spread = f" ± {100 * sigma:.0f} %"
        if np.isfinite(known_statures[i]):
            statures[i] = known_statures[i]
            spread = ""
        notes.append(
            f"person {i} is a child of {years[i]:g} years, {statures[i]:.2f} m{spread} tall "
            f"before the joint fit"
        )
    seems = 1 - adult_probability(known_statures, years, child) >= LEAST_PROBABILITY
    mean, sigma = log_stature_of_children()
    for i in np.flatnonzero(seems & has_body).tolist():
        statures[i] = np.exp(mean)
        notes.append(
            f"person {i} is probably a child, and gets a child's usual height, {statures[i]:.2f} m "
            f"± {100 * sigma:.0f} %. If you know the age, give "
            f"{size_option('--age YEARS', len(betas))}"
        )
    near = None
    if model.name == "embedded":
        children = np.isfinite(statures)
        betas[children] = table.betas(np.log(statures[children]))
        near = betas
    return bodies_of_stature(bodies, model, statures, near), notes
