"""Who is a child, and how tall: a posterior over the scale of the scene and the age of each person.

Body estimators take all people for adults, so that children come out as adults who are farther away. The size that an
estimated body would have to have, to stand on the floor and at the depth where the photo shows it, depends on the scale
of the scene, which all people share. Given the scale, people are independent: the posterior is a product of one mixture
over ages a person, on a grid of scales. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.adapters.observed import observed_joints
from physic_core.body.ages import ADULT_YEARS, load_ages
from physic_core.body.joints import joint_pair
from physic_core.body.parameters import rotations_from_parameters
from physic_core.engine.scene.stature import STATURE_SIGMA
from physic_core.geometry.tensors import tensor
from physic_core.pipeline.known_sizes import bodies_of_stature
from physic_core.types import AgeEstimates
from physic_core.types.per_person import select_people
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.body.model import BodyModel
    from physic_core.types import Bodies, FloatArray, Hints
    from physic_core.types.known_sizes import KnownPeople

__all__ = ["AgeEstimates", "AgeEvidence", "AgeSettings", "age_evidence", "estimate_ages"]

_FEET, _ANKLES, _KNEES = joint_pair("foot"), joint_pair("ankle"), joint_pair("knee")
_SCALE_STEP = 0.03  # of the grid of log scale
_BIAS, _SLOPE = (grid.ravel() for grid in np.meshgrid(*2 * [np.linspace(-2.1, 2.1, 7)]))  # standard deviations


@dataclass(frozen=True)
class AgeSettings:
    """What photos of people are like; chosen on worlds of seeds 7001 (children) and 7002 (adults), not fitted.

    Attributes:
        child_share: share of people under 16 years among the people of photos; 0 takes all people for adults.
        least_probability: from which a person is taken for a child.
        floor_sigma: error of log size from the soles on the floor, besides that of the scale.
        off_floor: share of people whose seen feet are not on the floor that was found.
        wrong_points: share of people whose points are those of something else.
        raised: how much larger people come out whose feet are over the floor, log; mean and standard deviation.
        wrong_sigma: error of log size where the points are those of something else.
        points_sigma: error of log size from the depth of a person's points, besides that of the scale.
        points_bias: how much farther than the scene the points of all people of a photo come out, log; mean and
            standard deviation.
        depth_slope: by how much the log size of people grows with log depth, because the point map is bent; standard
            deviation.
    """

    child_share: float = 0.0
    least_probability: float = 0.8
    floor_sigma: float = 0.08
    off_floor: float = 0.15
    wrong_points: float = 0.1
    raised: tuple[float, float] = (0.3, 0.3)
    wrong_sigma: float = 0.7
    points_sigma: float = 0.12
    points_bias: tuple[float, float] = (0.05, 0.08)
    depth_slope: float = 0.2


@dataclass(frozen=True)
class AgeEvidence(ShortRepr):
    """What one photo says about the sizes of N people. NaN where unknown.

    Attributes:
        stature: (N,) metres, of the estimated bodies.
        depth: (N,) metres, of the same.
        by_floor: (N,) log scale of the scene, metres per unit, if the estimated body stands on its floor.
        by_points: (N,) log scale of the scene if the estimated body is at the depth of the person's points.
        floor_height: of the camera over the floor in units of the scene, or None.
    """

    stature: FloatArray
    depth: FloatArray
    by_floor: FloatArray
    by_points: FloatArray
    floor_height: float | None


def find_children(
    bodies: Bodies, model: BodyModel, hints: Hints, settings: AgeSettings, known: KnownPeople
) -> AgeEstimates | None:
    """Estimate who is a child; None without people who could be one.

    Args:
        bodies: of N people, of the configured body model; those of known stature have it.
        model: the configured body model.
        hints: people, keypoints, intrinsics, floor and aligned point map of the photo.
        settings: what photos are like.
        known: by the user.
    """
    p = bodies.parameters
    finite = np.asarray(np.isfinite(np.concatenate([p.betas, p.transl, p.body_pose], 1)).all(1))
    unknown = np.full(len(finite), np.nan)
    years = unknown if known.years is None else known.years
    stature = unknown if known.stature is None else known.stature
    if not finite.any() or not (settings.child_share or (years < ADULT_YEARS).any()):
        return None
    assert hints.people is not None
    assert hints.keypoints is not None
    shown = replace(hints, people=select_people(hints.people, finite), keypoints=select_people(hints.keypoints, finite))
    evidence = age_evidence(select_people(bodies, finite), model, shown)
    found = estimate_ages(evidence, settings, years[finite], stature[finite], known.camera_height)

    def of_all(values: FloatArray, missing: float) -> FloatArray:
        everyone = np.full(len(finite), missing, values.dtype)
        everyone[finite] = values
        return everyone

    return AgeEstimates(
        child_probability=of_all(found.child_probability, np.nan),
        years=of_all(found.years, np.nan),
        years_sigma=of_all(found.years_sigma, np.nan),
        stature=of_all(found.stature, np.nan),
        stature_sigma=of_all(found.stature_sigma, np.nan),
    )


def resize_children(bodies: Bodies, model: BodyModel, ages: AgeEstimates) -> Bodies:
    """Give children the shape of their stature, as large in the photo as before; adults stay as they are."""
    rows = np.isfinite(ages.stature)
    if not rows.any():
        return bodies
    near = None
    if model.name == "embedded":
        near = np.array(bodies.parameters.betas, np.float64)
        near[rows] = load_ages().betas(np.log(ages.stature[rows]))
    return replace(bodies_of_stature(bodies, model, ages.stature, near), stature_sigma=ages.stature_sigma)


def age_evidence(bodies: Bodies, model: BodyModel, hints: Hints) -> AgeEvidence:
    """Measure what a photo says about the sizes of N people.

    Args:
        bodies: estimated, of the configured body model.
        model: that body model.
        hints: people, keypoints, intrinsics, floor and aligned point map of the photo.
    """
    assert hints.people is not None
    p, count = bodies.parameters, len(bodies.parameters)
    model = model.to(dtype=torch.float32)
    with torch.no_grad():
        betas, transl = tensor(p.betas).float(), tensor(p.transl).float()
        rotations = rotations_from_parameters(p).float()
        vertices = model(rotations, betas, transl).vertices.double().numpy()
        stature = model.stature(betas).double().numpy()
    by_floor, by_points = np.full((2, count), np.nan)
    seen = bodies.observed
    if hints.keypoints is not None and hints.intrinsics is not None and seen is None:
        seen = observed_joints(hints.keypoints, hints.intrinsics.height, hints.intrinsics.width)
    if hints.floor is not None and hints.floor.offset > 0 and seen is not None:
        feet = seen[:, _FEET].any(1) & seen[:, _ANKLES].any(1)
        drop = -(vertices[:, model.soles.numpy()] @ np.asarray(hints.floor.normal, np.float64)).min(1)
        by_floor = np.log(np.where(feet & (drop > 0), drop, np.nan) / hints.floor.offset)
    if hints.original is not None:
        depth = np.where(hints.original.valid, hints.original.points[..., 2], np.nan)
        # Without a leg in sight the size of an estimated body is a guess.
        legs = np.ones(count, bool) if seen is None else np.any(seen[:, _KNEES] | seen[:, _ANKLES], axis=1)
        for i, mask in enumerate(hints.people.masks):
            shown = depth[mask & np.isfinite(depth) & legs[i]]
            if len(shown) and (near := float(np.median(shown))) > 0:
                by_points[i] = math.log(max(float(np.median(vertices[i, :, 2])), 1e-6) / near)
    return AgeEvidence(
        stature,
        np.maximum(vertices[:, :, 2].mean(1), 1e-3),
        by_floor,
        by_points,
        None if hints.floor is None or hints.floor.offset <= 0 else float(hints.floor.offset),
    )


def estimate_ages(
    evidence: AgeEvidence,
    settings: AgeSettings,
    known_years: FloatArray,
    known_stature: FloatArray,
    camera_height_m: float | None = None,
) -> AgeEstimates:
    """Return the most probable ages and statures of N people.

    Args:
        evidence: of one photo.
        settings: what photos are like.
        known_years: (N,) ages that the user knows, NaN where unknown.
        known_stature: (N,) metres, that the user knows, NaN where unknown: these people keep their bodies.
        camera_height_m: over the floor, if the user knows it.
    """
    weight, mean, sigma = _mixtures(evidence, settings, known_years, known_stature)
    measured = np.concatenate([evidence.by_floor, evidence.by_points])
    middle = measured[np.isfinite(measured)] if np.isfinite(measured).any() else np.zeros(1)
    log_scale = np.arange(middle.min() - 1.8, middle.max() + 0.6, _SCALE_STEP)[:, None]
    bias_mean, bias_sigma = settings.points_bias
    bias, slope = (bias_mean + bias_sigma * _BIAS)[None], (settings.depth_slope * _SLOPE)[None]
    prior = -(_BIAS**2 + _SLOPE**2)[None] / 2 + 0 * log_scale
    nearness = np.log(evidence.depth / np.exp(np.log(evidence.depth).mean()))
    if evidence.floor_height is not None and camera_height_m:
        prior = prior + _log_normal(log_scale + math.log(evidence.floor_height), math.log(camera_height_m), 0.03)
    people = []
    for i, stature in enumerate(evidence.stature):
        by_floor, by_points = evidence.by_floor[i], evidence.by_points[i]
        states: list[tuple[FloatArray, FloatArray, float]] = []
        if not (math.isnan(by_floor) and math.isnan(by_points)):
            states = _size_states(by_floor, by_points, log_scale - slope * nearness[i], bias, settings)
        people.append(_given_scale(weight[i], mean[i], sigma[i], math.log(stature), states, prior.shape))
    total = prior + sum(np.logaddexp.reduce(one.log_likelihood, axis=-1) for one in people)
    posterior = np.exp(total - total.max())
    posterior /= posterior.sum()
    return AgeEstimates(
        *np.transpose(
            [
                _age(one, posterior, math.log(stature), years, settings.least_probability)
                for one, stature, years in zip(people, evidence.stature, known_years, strict=True)
            ]
        )
    )


@dataclass(frozen=True)
class _GivenScale:
    """A person for each scale and nuisance (S, B) and class (C + 1): log likelihood, and moments of log stature."""

    log_likelihood: FloatArray
    mean: FloatArray
    variance: FloatArray


def _given_scale(
    weight: FloatArray,
    mean: FloatArray,
    sigma: FloatArray,
    log_stature: float,
    states: Sequence[tuple[FloatArray, FloatArray, float]],
    grid: tuple[int, ...],
) -> _GivenScale:
    """Return what a person's measures say about the classes of age at each scale.

    Args:
        weight: log weight (C + 1) of each class.
        mean: of log stature in each class, (C + 1).
        sigma: standard deviation of it.
        log_stature: of the estimated body.
        states: of what was measured, as :func:`_size_states` returns them; empty without a measure.
        grid: (S, B), numbers of scales and of nuisances.
    """
    shape = (*grid, len(weight))
    if not states:
        return _GivenScale(*(np.broadcast_to(each, shape) for each in (weight, mean, sigma**2)))
    likely, means, variances = [], [], []
    for log_share, factor, error in states:
        # The factor by which the estimated body has to be enlarged is the ratio of the statures.
        shown = (log_stature + factor)[..., None]
        total = sigma**2 + error**2
        gain = sigma**2 / total
        likely.append(log_share[..., None] + _log_normal(shown, mean, np.sqrt(total)))
        means.append(mean + gain * (shown - mean))
        variances.append(np.broadcast_to(gain * error**2, shape))
    joint = np.logaddexp.reduce(likely)
    share = np.exp(np.stack(likely) - joint)
    moment = (share * means).sum(0)
    square = (share * (np.square(means) + variances)).sum(0)
    return _GivenScale(weight + joint, moment, square - moment**2)


def _age(
    person: _GivenScale, posterior: FloatArray, log_stature: float, known_years: float, least_probability: float
) -> tuple[float, float, float, float, float]:
    """Return the fields of :class:`AgeEstimates` of one person, NaN for those of a child if it is none.

    Args:
        person: at each scale.
        posterior: (S, B) of scale and nuisances.
        log_stature: of the estimated body.
        known_years: by the user, NaN where unknown.
        least_probability: from which a person is a child.
    """
    ages, one = load_ages(), person.log_likelihood
    classes = np.exp(one - np.logaddexp.reduce(one, axis=-1)[..., None]) * posterior[..., None]
    share = classes.sum((0, 1))
    child = max(1 - float(share[0]), 0.0)
    years = years_sigma = stature = math.nan
    taken = log_stature
    if child > least_probability:
        taken = (classes * person.mean)[..., 1:].sum() / child
        stature = math.exp(taken)
        years, years_sigma = known_years, 0.0
        if math.isnan(known_years):
            span = ages.years[:, 1] - ages.years[:, 0]
            years = float(share[1:] @ ages.middle / child)
            years_sigma = math.sqrt(share[1:] @ ((ages.middle - years) ** 2 + span**2 / 12) / child)
    sigma = math.sqrt((classes * ((person.mean - taken) ** 2 + person.variance)).sum())
    return child, years, years_sigma, stature, sigma


def _mixtures(
    evidence: AgeEvidence, settings: AgeSettings, known_years: FloatArray, known_stature: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return log weight, mean and standard deviation (N, C + 1) of log stature: the estimated body, then children."""
    ages, own = load_ages(), np.log(evidence.stature)
    count, classes = len(own), len(ages.middle) + 1
    share = np.append(1 - settings.child_share, settings.child_share * ages.share)
    with np.errstate(divide="ignore"):
        weight = np.tile(np.log(share), (count, 1))
    mean = np.column_stack([own, np.tile(ages.log_stature, (count, 1))])
    sigma = np.tile(np.append(STATURE_SIGMA, ages.sigma), (count, 1))
    for i, (years, stature) in enumerate(zip(known_years, known_stature, strict=True)):
        if np.isfinite(years) and years < ADULT_YEARS:
            mean[i, 1:], sigma[i, 1:] = ages.at_age(years)
            weight[i] = np.append(-np.inf, np.full(classes - 1, -math.log(classes - 1)))
        elif np.isfinite(years) or np.isfinite(stature):
            weight[i, 1:] = -np.inf
        if np.isfinite(stature):
            mean[i], sigma[i] = own[i], 0.01
    return weight, mean, sigma


def _size_states(
    by_floor: float, by_points: float, log_scale: FloatArray, bias: FloatArray, settings: AgeSettings
) -> list[tuple[FloatArray, FloatArray, float]]:
    """Return log share, log factor on the body (S, B) and error of that, for each state of what was measured.

    A body that the scene shows at half of its size has to become half as large: the factor is s over its own scale. The
    feet are on the floor or not, and the points are at the person's depth or not.
    """
    on, right = 1 - settings.off_floor, 1 - settings.wrong_points
    floor = log_scale - by_floor + 0 * bias
    points = log_scale - by_points - bias
    larger, spread = settings.raised
    raised = floor - larger  # feet over the floor seem to be those of a larger person
    if math.isnan(by_points):
        return [
            (math.log(on) + 0 * floor, floor, settings.floor_sigma),
            (math.log(1 - on) + 0 * floor, raised, spread),
        ]
    if math.isnan(by_floor):
        return [
            (math.log(right) + 0 * points, points, settings.points_sigma),
            (math.log(1 - right) + 0 * points, points, settings.wrong_sigma),
        ]
    apart = math.hypot(settings.floor_sigma, settings.points_sigma)
    trust = settings.points_sigma**2 / apart**2
    both = trust * floor + (1 - trust) * points
    error = settings.floor_sigma * settings.points_sigma / apart
    return [
        (math.log(on * right) + _log_normal(floor, points, apart), both, error),
        (math.log((1 - on) * right) + _log_normal(raised, points, spread), points, settings.points_sigma),
        (math.log(on * (1 - right)) + _log_normal(points, floor, settings.wrong_sigma), floor, settings.floor_sigma),
        (
            math.log((1 - on) * (1 - right)) + _log_normal(points, raised, settings.wrong_sigma),
            raised,
            spread,
        ),
    ]


def _log_normal(value: FloatArray, mean: FloatArray | float, sigma: FloatArray | float) -> FloatArray:
    """Return the logarithm of a normal density, up to a common constant."""
    density: FloatArray = -(((value - mean) / sigma) ** 2) / 2 - np.log(sigma)
    return density
