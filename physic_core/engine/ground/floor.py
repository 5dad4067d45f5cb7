"""Find the floor among a few planes, each with a score, so that evidence moves the answer instead
of switching it.

Candidates are planes through the floor masks of the segmenter, the pixels labelled as floor, the
lower part of the image, its horizontal surfaces, and the soles of people. All are scored on the
same pixels and by the ground beside soles, and compared with no floor at all. The sizes of people
depend on the scale, and are added by :func:`physic_core.engine.sizes.scale_vote.vote_on_scale`.
OpenCV camera frame, any unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.body.posture import LYING_DEG, standing_legs, trunk_tilt_deg
from physic_core.engine.ground.lying import LYING_RATE, Background, plane_beneath_lying_people
from physic_core.engine.ground.posture import UPRIGHT_DEG
from physic_core.engine.up import Up, angle_deg, level_plane
from physic_core.geometry.floor import (
    FOCAL_PITCH_DEG,
    MASK_SLACK,
    PITCH_SIGMA,
    FloorSearch,
    FloorSource,
    PlaneFit,
    move_to_feet,
    plane_as_fit,
    plane_at_feet,
    plane_of_pixels,
    ray_to_floor,
)
from physic_core.geometry.inverse_depth import (
    HOLE_WEIGHT,
    LOWER_SHARE,
    InverseDepthMap,
    inverse_depth_map,
    lower_inlier_shares,
)
from physic_core.geometry.pixels import quantiles
from physic_core.geometry.plane import estimate_up, sample_normals
from physic_core.geometry.tensors import exact_arrays

MIN_UP_CONFIDENCE = 0.11
"""Confidence of an up direction that counts fully, see
:class:`physic_core.geometry.plane.UpEstimate`.
"""

_SAMPLES = 16_000  # pixels that score
_PIXEL_NATS = 6.0  # weight of all pixels together: neighbours share their error
_NO_LABEL = (0.500, 0.498, 0.002)
_MASK = (0.700, 0.270, 0.030)
_GROUND = (0.850, 0.130, 0.020)
_NO_GROUND = (0.100, 0.898, 0.002)
"""Share of pixels on, in front of and behind the floor, by label: one does not see through a
floor.
"""

SOLE_SIGMA = 0.05
"""Standard deviation of the height of the ground beside soles over the floor, in heights of the
camera, if the person stands on it; and so of the logarithm of a scale by one person's soles.
"""
_ELSEWHERE = 0.5  # density of that height if the person does not
_FAR_OFF = 0.4  # height of that ground over a plane that is not moved to it
_MOST_SOLES = 3.0  # independent observations that the soles of all people are worth

# Tolerances in the range of inverse depth, over which pixels off the plane are spread.
_BANDS = 50.0
_OFF_GROUND = 0.07  # height of all seen ground over a floor, in heights of the camera: .1 of 1.5 m
_FEWEST_GROUND = 0.02  # share of the photo that shows ground
_OFF_GROUND_NATS = -3.0  # for a plane off it: what stands on the plane stands on something else
_NO_FLOOR_NATS = 1.5  # for "no floor", which has no pixel to explain
_UP_SIGMA_DEG = 6.0  # of a confident up direction
_AXIS_SIGMA_DEG = 15.0  # between people who stand straight and up
_IN_MASK_SHARE = 0.4  # least share of a floor mask on a floor that is where the segmenter sees it
# Of a camera over people who lie, from straight down: a guess, one photo has 6 degrees.
_DOWN_SIGMA_DEG = 12.0
# Of cameras in hands: mean log density -2.45 on 57 floors of one half of the labelled photos that
# readers find right, and -2.52 on 63 of the other; -3.26 and -3.30 with 8 degrees. With 2 degrees,
# right floors on slopes are lost.
_ROLL_SIGMA_DEG = 3.0
# The best of one half of the labelled photos: mean log density of the other half -2.89, and -3.54
# with a median of 0 and 30 degrees.
_PITCH_DEG = 6.0  # median, down
_PITCH_SIGMA_DEG = 9.0
# Least cosine between up and the normal of a horizontal pixel.
_LEVEL_COSINE = math.cos(math.radians(25.0))


class GroundAtSoles(NamedTuple):
    """Visible ground beside the soles of one person.

    Attributes:
        rows: (M,) int64, of its pixels.
        columns: (M,) int64.
        stand_probability: probability that the person stands on the floor, before one is known.
        person_probability: probability that it is a person.
        person: row of the person.
    """

    rows: Tensor
    columns: Tensor
    stand_probability: float
    person_probability: float
    person: int


@dataclass(frozen=True)
class FloorEvidence:
    """Evidence of a photo about its floor.

    Attributes:
        hole: (H, W) bool, inpainted pixels.
        feet_px: (F, 2) px, floor pixels at people's soles; F may be 0.
        ground: (H, W) bool, pixels with the label of a floor.
        no_ground: (H, W) bool, pixels with the label of something else.
        mask: (H, W) bool, pixels that a segmenter takes for the floor, or None.
        other_masks: (H, W) bool each, other masks of what may be the floor.
        ground_at_soles: of people whose soles are seen.
        backgrounds: background around people who are seen from shoulders to ankles.
        known_search: the answer for the same photo; None before the search.
        up: against gravity, by other evidence than the floor; None if there is none.
        slope_sigma_deg: standard deviation of the floor's normal from up, degrees.
        focal_sigma: standard deviation of the logarithm of the focal length.
        shift_sigma: standard deviation of the shift of inverse depth, 1 / unit of the points.
    """

    hole: Tensor
    feet_px: Tensor
    ground: Tensor
    no_ground: Tensor
    mask: Tensor | None = None
    other_masks: tuple[Tensor, ...] = ()
    ground_at_soles: tuple[GroundAtSoles, ...] = ()
    backgrounds: tuple[Background, ...] = ()
    known_search: FloorSearch | None = None
    up: Up | None = None
    slope_sigma_deg: float = 0.0
    focal_sigma: float = 0.0
    shift_sigma: float = 0.0

    @property
    def seen_ground(self) -> Tensor | None:
        """Visible pixels (H, W) bool with the label of a floor; None if they are few."""
        visible = self.ground & ~self.hole
        return visible if int(visible.sum()) >= _FEWEST_GROUND * visible.numel() else None


@dataclass(frozen=True)
class FloorCandidate:
    """A plane that may be the floor, or no floor.

    Attributes:
        plane: moved to the feet; None for no floor.
        nats: what speaks for it -> nats: "pixels" with their labels, "gravity" and "soles".
    """

    plane: PlaneFit | None
    nats: Mapping[str, float]

    @property
    def log_score(self) -> float:
        """All evidence together, nats."""
        return sum(self.nats.values())


def index_of_best(candidates: Sequence[FloorCandidate]) -> int:
    """Return the candidate with the largest score by the pixels alone."""
    return max(range(len(candidates)), key=lambda i: candidates[i].log_score)


def describe_floor(
    candidates: tuple[FloorCandidate, ...], best: int, evidence: FloorEvidence
) -> FloorSearch:
    """Return one of the candidates as the answer of a search."""
    plane = candidates[best].plane
    if plane is None:
        empty = [
            (c.plane.inlier_share, c.plane.below_share) for c in candidates if c.plane is not None
        ]
        return FloorSearch(None, "no_consensus", *max(empty, default=(0.0, 0.0)))
    masks = [
        m
        for m in (evidence.mask, evidence.ground, *evidence.other_masks)
        if m is not None and m.any()
    ]
    shares = [float(plane.inliers[mask].double().mean()) for mask in masks]
    in_mask = max(shares) > _IN_MASK_SHARE if shares else None
    other = _pitch_spread(candidates, plane)
    sigma = math.hypot(_pitch_sigma(plane, evidence), other)
    levelled = sigma if evidence.up is None else math.hypot(plane.pitch_sigma, other)
    plane = replace(plane, pitch_sigma=levelled, plane_sigma=sigma)
    return FloorSearch(plane, "found", plane.inlier_share, plane.below_share, in_mask)


def _pitch_sigma(plane: PlaneFit, evidence: FloorEvidence) -> float:
    """Return the error of the camera's pitch over a plane by its pixels, radians."""
    by_focal = math.radians(FOCAL_PITCH_DEG) * evidence.focal_sigma
    # A shift of inverse depth is added to the last component of normal over offset.
    by_shift = evidence.shift_sigma * plane.offset * math.sqrt(1 - float(plane.normal[2]) ** 2)
    return math.hypot(PITCH_SIGMA, by_focal, by_shift)


def _levelled_plane(view: InverseDepthMap, plane: PlaneFit, evidence: FloorEvidence) -> PlaneFit:
    """Return a plane with its error, turned towards up about the feet on it."""
    sigma = _pitch_sigma(plane, evidence)
    plane = replace(plane, plane_sigma=sigma, pitch_sigma=sigma)
    ray = ray_to_floor(view.rays, plane, evidence.feet_px)
    return level_plane(plane, evidence.up, evidence.slope_sigma_deg, ray)


def _pitch_spread(candidates: tuple[FloorCandidate, ...], chosen: PlaneFit) -> float:
    """Return the rms difference of the camera's pitch over other planes by their scores,
    radians.
    """
    scored = [(c.plane.normal, c.log_score) for c in candidates if c.plane is not None]
    best = max(score for _, score in scored)
    weights = [math.exp(score - best) for _, score in scored]
    pitches = [
        math.asin(float(normal[2])) - math.asin(float(chosen.normal[2])) for normal, _ in scored
    ]
    square = sum(w * p**2 for w, p in zip(weights, pitches, strict=True)) / sum(weights)
    return math.sqrt(square)


def floor_candidates(
    points: Tensor, valid: Tensor, evidence: FloorEvidence, normals: Tensor
) -> tuple[FloorCandidate, ...]:
    """Return at most seven planes that may be the floor, and last the candidate without a floor.

    Args:
        points: (H, W, 3), any unit, preferably of the photo without its people.
        valid: (H, W) bool.
        evidence: of the floor.
        normals: (H, W, 3) unit, zero where unknown.
    """
    view = inverse_depth_map(points, valid, evidence.hole)
    if view is None:
        return (FloorCandidate(None, {}),)
    sample = sample_normals(normals, view.valid)
    up = _floor_up(evidence, sample)
    pixel_score = _pixel_score(view, evidence)
    ground = _sample_of_ground(view, evidence)

    def candidate(fit: PlaneFit, moved: PlaneFit) -> FloorCandidate:
        plane = fit.by_ray
        nats = {
            "pixels": pixel_score(plane),
            "gravity": _gravity_score(fit, evidence, sample),
            "soles": _sole_score(_heights_at_soles(view, plane, evidence.ground_at_soles)),
        }
        if _is_off_ground(ground, moved):
            nats["ground that is seen"] = _OFF_GROUND_NATS
        return FloorCandidate(_levelled_plane(view, moved, evidence), nats)

    candidates = [
        candidate(fit, _plane_at_people(view, fit, mask, evidence, ground))
        for fit, mask in _fitted_planes(view, evidence, normals, up)
    ]
    if (
        up is None
        and candidates
        and (likeliest := candidates[index_of_best(candidates)].plane) is not None
    ):
        up = likeliest.normal
    if up is not None and len(evidence.feet_px):
        at_feet = plane_at_feet(view, up, evidence.feet_px)
        candidates += [] if at_feet is None else [candidate(at_feet, at_feet)]
    candidates.append(FloorCandidate(None, {"no pixel to explain": _NO_FLOOR_NATS}))
    beneath = _candidate_beneath_people(view, evidence, candidates)
    return tuple(candidates) if beneath is None else (beneath, *candidates)


def _floor_up(evidence: FloorEvidence, normals: Tensor) -> Tensor | None:
    """Return the up direction (3,) of floors by surfaces with normals (M, 3), and rather by what
    else shows it; None if neither is sure.
    """
    if evidence.up is not None and evidence.up.sigma < _UP_SIGMA_DEG:
        return evidence.up.direction
    shown = estimate_up(normals)
    return shown.up if shown is not None and shown.confidence >= MIN_UP_CONFIDENCE else None


def _plane_at_people(
    view: InverseDepthMap,
    fit: PlaneFit,
    mask: Tensor | None,
    evidence: FloorEvidence,
    ground: tuple[Tensor, Tensor],
) -> PlaneFit:
    """Return a plane moved to the ground beside soles, or else to the feet; where they stand on
    something else than the ground that is seen, it stays.
    """
    moved = _plane_through_soles(fit, _heights_at_soles(view, fit.by_ray, evidence.ground_at_soles))
    moved = moved or move_to_feet(view, fit, mask, evidence.feet_px)
    return fit if _is_off_ground(ground, moved) and not _is_off_ground(ground, fit) else moved


def _candidate_beneath_people(
    view: InverseDepthMap, evidence: FloorEvidence, others: Sequence[FloorCandidate]
) -> FloorCandidate | None:
    """Return the plane on which people lie beneath the camera; None without evidence of it.

    All other candidates are floors of people who do not lie beneath the camera.
    """
    plane, odds = plane_beneath_lying_people(view.rays, view.inverse, evidence.backgrounds)
    if plane is None:
        return None
    shares = lower_inlier_shares(view, plane)
    fit = plane_as_fit(view, plane, shares, "people who lie", MASK_SLACK)
    odds = others[index_of_best(others)].log_score + odds
    # A camera that looks down has a level horizontal axis, and the sky is not below it. A plane
    # that it sees at a flatter angle is behind people rather than beneath them.
    x, y, z = (math.degrees(math.asin(float(value))) for value in fit.normal.clamp(-1, 1))
    odds += _robust_nats(x / _ROLL_SIGMA_DEG) + _robust_nats(max(0.0, y) / _ROLL_SIGMA_DEG)
    odds += _up_score(fit, evidence)
    odds -= 0.5 * ((90 + z) / _DOWN_SIGMA_DEG) ** 2
    return FloorCandidate(fit, {"people who lie": odds})


def _fitted_planes(
    view: InverseDepthMap, evidence: FloorEvidence, normals: Tensor, up: Tensor | None
) -> list[tuple[PlaneFit, Tensor | None]]:
    """Return the planes of masks, lower part and horizontal surfaces, each with its mask."""
    regions: list[tuple[FloorSource, Tensor | None, Tensor | None]] = [
        ("floor mask", evidence.mask, None)
    ]
    regions += [("floor mask", other, None) for other in evidence.other_masks[:1]]
    regions += [("labels", evidence.ground, None)]
    regions = [region for region in regions if region[1] is not None and region[1].any()]
    regions += [("lower image", None, up)]
    planes = []
    for source, mask, direction in regions:
        fit = plane_of_pixels(view, mask, direction, source, 1.0 if mask is None else MASK_SLACK)
        planes += [] if fit is None else [(fit, mask)]
    if planes and up is not None:
        # A large table or seat is horizontal, too: the next largest surface may be the floor.
        level = view.valid & ~planes[-1][0].inliers
        first = len(level) - math.floor(LOWER_SHARE * len(level))
        level[:first] = False
        level[first:] &= normals[first:].double() @ up > _LEVEL_COSINE
        fit = plane_of_pixels(view, level, up, "level surfaces", MASK_SLACK)
        planes += [] if fit is None else [(fit, level)]
    return planes


def _pixel_score(view: InverseDepthMap, evidence: FloorEvidence) -> Callable[[Tensor], float]:
    """Return the function from a plane (3,) to its tempered log likelihood ratio over no plane, by
    the pixels of the lower part of the image and those with the label of a floor, nats.
    """
    height, width = view.valid.shape
    step = max(1, math.ceil(math.sqrt(height * width / _SAMPLES)))
    rows, columns = torch.meshgrid(
        torch.arange(step // 2, height, step), torch.arange(step // 2, width, step), indexing="ij"
    )
    use = (rows >= (1 - LOWER_SHARE) * height) | evidence.ground[rows, columns]
    use &= view.valid[rows, columns]
    rows = rows[use]
    columns = columns[use]
    weight = 1.0 + rows.double() / height
    weight = weight * torch.where(evidence.hole[rows, columns], HOLE_WEIGHT, 1.0)
    weight = weight / weight.sum()
    on, front, behind = _ground_log_odds(evidence, rows, columns).unbind(-1)
    rays = view.rays[rows, columns].double()
    inverse = view.inverse[rows, columns].double()

    def score(plane: Tensor) -> float:
        error = (inverse - rays @ plane) / (MASK_SLACK * view.tolerance)
        likelihood = on * torch.exp(-0.5 * error.square()) / math.sqrt(2 * math.pi)
        likelihood = likelihood + 2 / _BANDS * (
            front * torch.sigmoid(2 * error) + behind * torch.sigmoid(-2 * error)
        )
        return _PIXEL_NATS * float((weight * (likelihood * _BANDS).log()).sum())

    return score


def _ground_log_odds(evidence: FloorEvidence, rows: Tensor, columns: Tensor) -> Tensor:
    """Return the shares (M, 3) on, in front of and behind the floor of pixels with their labels."""
    odds = rows.new_tensor(_NO_LABEL, dtype=torch.float64).expand(len(rows), 3)
    for mask, known in (
        (evidence.mask, _MASK),
        (evidence.ground, _GROUND),
        (evidence.no_ground, _NO_GROUND),
    ):
        if mask is not None:
            odds = torch.where(mask[rows, columns][:, None], odds.new_tensor(known), odds)
    return odds


def _heights_at_soles(
    view: InverseDepthMap, plane: Tensor, soles: tuple[GroundAtSoles, ...]
) -> list[tuple[float, float, float]]:
    """Return the height over a plane (3,) of the ground beside the soles of each person, and the
    probabilities that they stand and that they are people.

    The unit is the height of the camera, so that the scale does not matter.
    """
    heights = []
    for rows, columns, stands, real, _ in soles:
        inverse = view.inverse[rows, columns].double()
        is_known = inverse > 0
        if is_known.any():
            on_plane = view.rays[rows, columns].double() @ plane
            height = float((1 - on_plane[is_known] / inverse[is_known]).median())
            heights.append((height, stands, real))
    return heights


def _sole_score(heights: list[tuple[float, float, float]]) -> float:
    """Return the log likelihood of the ground beside soles by a plane, less that without a plane,
    nats.

    If a person stands on the plane, that ground lies on it.
    """
    score = 0.0
    for height, stands, real in heights:
        on_floor = stands * real
        score += math.log(1 - on_floor + on_floor * standing_log_odds(height))
    return score * min(1.0, _MOST_SOLES / max(len(heights), 1))


def standing_log_odds(height: float) -> float:
    """Return how much likelier ground beside soles is so high over the floor if the person stands
    on it than if not; heights of the camera.
    """
    density = math.exp(-0.5 * (height / SOLE_SIGMA) ** 2)
    return density / (SOLE_SIGMA * math.sqrt(2 * math.pi) * _ELSEWHERE)


def _plane_through_soles(
    fit: PlaneFit, heights: list[tuple[float, float, float]]
) -> PlaneFit | None:
    """Return the plane moved to the median ground beside the soles of people who stand; None if it
    is far off.
    """
    stand = sorted(height for height, stands, _ in heights if stands > 0.5)
    if not stand or abs(height := median(stand)) > _FAR_OFF:
        return None
    return fit.moved(1 / (1 - height))


def standing_score(normal: Tensor, joints: Tensor) -> float:
    """Return the score of a floor with a normal (3,) by people (N, 55, 3), nats: straight people
    stand upright on it, and most people do not lie on it.

    The camera axis that points up distinguishes people who lie straight from people who stand.
    """
    people, up = exact_arrays(joints, normal)
    tilt = np.sort(np.abs(trunk_tilt_deg(people, up) - 90.0))
    lie = len(tilt) and tilt[len(tilt) // 2] < LYING_DEG
    rate = math.log(LYING_RATE / (1 - LYING_RATE)) if lie else 0.0
    axes = joints[torch.from_numpy(standing_legs(people).all(1))].double()
    axes = torch.nn.functional.normalize(
        axes[:, JOINT_INDEX["neck"]] - axes[:, joint_pair("ankle")].mean(1), dim=-1
    )
    axes = axes[-axes[:, 1] > math.cos(math.radians(UPRIGHT_DEG))]
    angles = sorted(angle_deg(axis, normal) for axis in axes)
    return rate + (_robust_nats(angles[len(angles) // 2] / _AXIS_SIGMA_DEG) if angles else 0.0)


def _gravity_score(plane: PlaneFit, evidence: FloorEvidence, normals: Tensor) -> float:
    """Return the score of a floor by gravity, nats: from the camera, and from up if it is known,
    else from surfaces with normals (M, 3).
    """
    normal = plane.normal
    x, y, z = (float(v) for v in normal)
    roll = math.degrees(math.atan2(x, -y))
    pitch = math.degrees(math.atan2(-z, math.hypot(x, y)))
    score = _robust_nats(roll / _ROLL_SIGMA_DEG) + _robust_nats(
        (pitch - _PITCH_DEG) / _PITCH_SIGMA_DEG
    )
    if evidence.up is not None:
        return score + _up_score(plane, evidence)
    estimate = estimate_up(normals, normal)
    if estimate is not None:
        trust = min(1.0, estimate.confidence / MIN_UP_CONFIDENCE)
        score += trust * _robust_nats(angle_deg(estimate.up, normal) / _UP_SIGMA_DEG)
    return score


def _up_score(plane: PlaneFit, evidence: FloorEvidence) -> float:
    """Return the score of a floor by its angle to up, nats; 0 if up is not known."""
    if evidence.up is None:
        return 0.0
    sigma = math.degrees(_pitch_sigma(plane, evidence))
    angle = angle_deg(evidence.up.direction, plane.normal)
    return _robust_nats(angle / math.hypot(sigma, evidence.slope_sigma_deg, evidence.up.sigma))


def _sample_of_ground(view: InverseDepthMap, evidence: FloorEvidence) -> tuple[Tensor, Tensor]:
    """Return rays (M, 3) and inverse depths (M,) of pixels that are labelled as ground; M = 0 where
    they are few.
    """
    seen = evidence.seen_ground
    if seen is None:
        return view.rays.new_zeros(0, 3), view.inverse.new_zeros(0)
    at = (seen & view.valid).flatten().nonzero()[:, 0]
    at = at[:: max(1, len(at) // _SAMPLES)]
    return view.rays.flatten(0, 1)[at], view.inverse.flatten()[at]


def _is_off_ground(ground: tuple[Tensor, Tensor], plane: PlaneFit) -> bool:
    """Return whether all pixels with rays (M, 3) and inverse depths (M,) lie off a floor, on one
    side.
    """
    rays, inverse = ground
    if not len(rays):
        return False
    low, high = quantiles(1 - rays @ plane.by_ray.to(rays) / inverse, (0.1, 0.9))
    return low > _OFF_GROUND or high < -_OFF_GROUND


def _robust_nats(sigmas: float) -> float:
    """Return a log likelihood, nats, which a wrong cue cannot lower without bound."""
    return -2 * math.log1p(sigmas**2 / 4)
