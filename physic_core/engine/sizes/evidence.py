"""Evidence of the scale of a scene: the logarithm of the scale by one observation, with its
standard deviation.

The sizes that the user knows are the most certain evidence, a usual size the least. Each person
also gives a scale, with the sigma of :mod:`.stature`. Since some people are not adults, they vote
in :mod:`.scale_vote`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.sizes.scale_vote import Witnesses
from physic_core.geometry.pixels import dilate_square
from physic_core.geometry.tensors import exact_arrays, tensor
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.sizes.scale_vote import ScaleVote
    from physic_core.geometry.floor import PlaneFit
    from physic_core.types import BoolArray, DepthMap, FloatArray, Int64Array, Intrinsics, Pointmap

KNOWN_SIZE_SIGMA = 0.002
"""Expected error of the logarithm of a known size; 1 % off costs 25, as much as ten keypoints on a
wrong limb.
"""

KNOWN_SCALE_SIGMA = 0.01
"""Expected error of log(scale) by a known size: its pixels and the floor are not exact."""

FACTOR_SPREAD = 0.05
"""Standard deviation of the logarithm of one size in the photo by another."""

CONTRADICTION = 3 * FACTOR_SPREAD
"""Difference of logarithms beyond which the photo contradicts a given size: three standard
errors.
"""

MEASURED_SIGMA = 0.05
"""Largest stated error of log(scale) of a metric depth that counts as measured: it decides, and
people follow it.
"""

DEPTH_SCALE_SIGMA = 0.1
"""Standard deviation of log(scale) of a metric depth whose backend states none."""

USUAL_CAMERA_HEIGHT_M = 1.45
"""Median height of a camera above the floor: people hold it at their chest or eyes, and some hang
high indoors.
"""

USUAL_CAMERA_HEIGHT_SIGMA = 0.5
"""Standard deviation of the logarithm of that height."""

USUAL_DEPTH_M = 3.0
"""Median depth of a scene of people, of which nothing else is known."""

USUAL_DEPTH_SIGMA = 1.0
"""Standard deviation of the logarithm of that depth."""

_MIN_PIXELS = 30


@dataclass(frozen=True)
class ScaleEvidence:
    """Scale of a scene by one observation.

    Attributes:
        log_scale: logarithm of the factor on the scene.
        sigma: its standard deviation, > 0.
    """

    log_scale: float
    sigma: float

    @classmethod
    def by_known_size(cls, metres: float, shown: float) -> ScaleEvidence:
        """Return the evidence of a known size, by the size that it has in the scene."""
        return cls(math.log(metres / shown), KNOWN_SCALE_SIGMA)


@dataclass(frozen=True)
class MeasuredScale:
    """Scale of a scene by a depth that was measured, beside its scale by people.

    Attributes:
        evidence: of the factor from the scale by people to that of the depth.
        people_sigma: standard deviation of log(scale) by people.
    """

    evidence: ScaleEvidence
    people_sigma: float

    @property
    def depth_over_people(self) -> float:
        """Size of the scene by the depth, over that by people."""
        return math.exp(self.evidence.log_scale)

    @property
    def sigmas(self) -> float:
        """Difference of both logarithms in standard deviations."""
        return abs(self.evidence.log_scale) / math.hypot(self.evidence.sigma, self.people_sigma)


_PER_METRE = {
    "meters": 1.0,
    "millimeters": 1000.0,
    "centimeters": 100.0,
    "feet": 3.281,
    "1/5000 m, as in TUM's data sets": 5000.0,
    "1/256 m, as in KITTI's data sets": 256.0,
    "1/10000 m": 10000.0,
}
_READ_AS = (1.0, 1000.0)  # units in one metre by which depth is read if none is stated
_UNIT_SPREAD = 0.2  # of the logarithm of a ratio that a unit explains: statures and poses vary


def likely_unit(factor: float) -> str:
    """Return a question about the unit of a depth that is too large by a factor."""
    ratios = {
        math.log(count / read): name
        for read in _READ_AS
        for name, count in _PER_METRE.items()
        if count != read
    }
    nearest = min(ratios, key=lambda ratio: abs(math.log(factor) - ratio))
    if abs(math.log(factor) - nearest) < _UNIT_SPREAD:
        return f"is its unit {ratios[nearest]}?"
    return "is it in meters along the optical axis, or only relative?"


def combined_scale(evidence: Sequence[ScaleEvidence]) -> ScaleEvidence | None:
    """Return the mean weighted by precision, in which the most certain evidence dominates; None
    without evidence.

    Its sigma is that of the most certain one: evidence of one kind shares its error.
    """
    if not evidence:
        return None
    least = min(e.sigma for e in evidence)
    weights = [(least / e.sigma) ** 2 for e in evidence]
    mean = sum(w * e.log_scale for w, e in zip(weights, evidence, strict=True)) / sum(weights)
    return ScaleEvidence(mean, least)


def scales_by_soles(
    vertices: FloatArray, model: BodyModel, feet: BoolArray, floor: PlaneFit
) -> FloatArray:
    """Return the scale (N, 2), metres per unit, that puts the left and the right sole of each
    person on the floor.

    With the plane n . X + h = 0 in units of the scene, a point X in metres lies on it for the scale
    -n . X / h. The normal does not depend on the scale, and the lowest vertex of a sole is the one
    with the largest.

    Args:
        vertices: (N, V, 3) metres.
        model: the body.
        feet: (N, 2) bool, visible feet.
        floor: plane in units of the scene.

    Returns:
        (N, 2) NaN for feet that are not visible.
    """
    (normal,) = exact_arrays(floor.normal)
    soles = exact_arrays(*(model.contact_sets[f"{side}_sole"] for side in SIDES))
    lowest = [(-vertices[:, ids] @ normal).max(1) / floor.offset for ids in soles]
    scale = np.stack(lowest, 1)
    return np.where(feet & (scale > 0), scale, np.nan)


def scales_by_torsos(
    vertices: FloatArray, model: BodyModel, masks: BoolArray, photo: Pointmap, camera: FloatArray
) -> FloatArray:
    """Return the scale (N,), metres per unit, that makes the relative depth of each torso equal to
    its depth in metres.

    Args:
        vertices: (N, V, 3) metres.
        model: the body.
        masks: (N, H, W) bool, visible pixels of each person.
        photo: point map of the photo with its people, in units of the scene.
        camera: (3, 3) px.

    Returns:
        (N,) NaN for people whose torso is not visible, or mostly at infinity in the point map.
    """
    faces, part = exact_arrays(model.faces, model.part_of_vertex)
    torso = part[faces[:, 0]] == model.part_names.index("torso")
    return np.array(
        [
            _scale_by_torso(body, faces, torso, mask, photo, camera)
            for body, mask in zip(vertices, masks, strict=True)
        ]
    )


_MIN_HITS = 20
# Of the long side: the depth of the background bleeds into the edge of a mask.
_ERODED_SHARE = 0.004


def _scale_by_torso(
    body: FloatArray,
    faces: Int64Array,
    torso: BoolArray,
    mask: BoolArray,
    photo: Pointmap,
    camera: FloatArray,
) -> float:
    """Return the median ratio of body depth to map depth over the pixels of a mask whose ray hits
    the torso first.
    """
    from physic_core.geometry.rays import RayCaster

    reach = max(1, round(_ERODED_SHARE * max(mask.shape)))
    inner = ~dilate_square(~tensor(mask), reach).numpy()
    rows, columns = _sampled_pixels(inner & photo.valid)
    if len(rows) < _MIN_PIXELS or not np.isfinite(body).all():
        return float("nan")
    directions = np.stack(
        [
            (columns - camera[0, 2]) / camera[0, 0],
            (rows - camera[1, 2]) / camera[1, 1],
            np.ones(len(rows)),
        ],
        -1,
    )
    hits = RayCaster(body, faces).first(np.zeros(3), directions)
    on_torso = (hits.face >= 0) & torso[hits.face]
    if on_torso.sum() < _MIN_HITS:
        return float("nan")
    # The ray's direction has z = 1, so the distance along it is the depth.
    ratio = hits.distance[on_torso] / photo.points[rows[on_torso], columns[on_torso], 2]
    scale = float(np.median(ratio[np.isfinite(ratio)]))
    return scale if scale > 0 else float("nan")


_RAYS = 4000  # largest number of sampled pixels


def _sampled_pixels(mask: BoolArray) -> tuple[Int64Array, Int64Array]:
    """Return rows and columns (n,) of at most :data:`_RAYS` pixels of a mask (H, W), evenly
    spaced.
    """
    rows, columns = np.nonzero(mask)
    chosen = np.linspace(0, len(rows) - 1, min(_RAYS, len(rows))).astype(int)
    return rows[chosen], columns[chosen]


_SURE = 0.9  # probability that a metric depth without a stated error is right
_SURE_IF_STATED = 0.99  # the same with one
_NEAR = 0.3  # standard deviation of the logarithm of depth, of pixels that count as near the people


def depth_witness(
    depth: DepthMap, scene: Pointmap, camera: Intrinsics, torsos: Witnesses
) -> Witnesses | None:
    """Return the scale of a relative scene by a metric depth; None if they have no pixel in common.

    It is the weighted median of the ratio of both. Pixels near the people have the largest weights,
    since an unknown shift of the inverse depth changes the ratio elsewhere. With an estimated
    camera, the depth is inferred from sizes in px, so it is proportional to the focal length.

    Args:
        depth: of the scene.
        scene: relative.
        camera: of the people's bodies.
        torsos: of the people.
    """
    scene_depth = scene.points[..., 2].astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        is_known = scene.valid & (scene_depth > 0) & (depth.depth > 0)
        ratio = depth.depth[is_known] / scene_depth[is_known]
    if not len(ratio):
        return None
    people = (torsos.depth / torsos.scale)[np.isfinite(torsos.scale)]
    weight = (
        np.exp(-0.5 * (np.log(scene_depth[is_known] / np.median(people)) / _NEAR) ** 2)
        if len(people)
        else 1.0
    )
    order = np.argsort(ratio)
    total = np.cumsum(np.broadcast_to(weight, ratio.shape)[order] + 1e-9)
    scale = float(ratio[order][np.searchsorted(total, 0.5 * total[-1])])
    if depth.intrinsics is not None and not depth.intrinsics.known:
        scale *= math.sqrt(camera.fx * camera.fy / (depth.intrinsics.fx * depth.intrinsics.fy))
    stated = depth.scale_sigma
    sigma, right_probability = (
        (DEPTH_SCALE_SIGMA, _SURE) if stated is None else (stated, _SURE_IF_STATED)
    )
    return Witnesses.single(scale, sigma, right_probability)


def median_depth(pointmap: Pointmap) -> float:
    """Return the median depth of the valid points of a point map, in its unit."""
    return float(np.median(pointmap.points[pointmap.valid, 2]))


def is_measured(depth: DepthMap) -> bool:
    """Return whether a metric depth states so small an error that it decides the scale."""
    return depth.scale_sigma is not None and depth.scale_sigma <= MEASURED_SIGMA


_DISPARITY = -0.3  # rank correlation with the scene's depth up to which a depth is its inverse


def is_inverse(depth: DepthMap, scene: Pointmap) -> bool:
    """Return whether a depth is larger where the scene is nearer, as a disparity is."""
    rows, columns = _sampled_pixels(scene.valid & (depth.depth > 0))
    if len(rows) < _MIN_PIXELS:
        return False
    values, points = depth.depth[rows, columns], scene.points[rows, columns, 2]
    if np.ptp(values) == 0 or np.ptp(points) == 0:  # a wall has no order
        return False
    return bool(np.corrcoef(_ranks(values), _ranks(points))[0, 1] <= _DISPARITY)


def _ranks(values: FloatArray) -> FloatArray:
    """Return the rank of each of (N,) values; equal ones share the mean of their ranks.

    As ``scipy.stats.rankdata``, whose import takes half a second.
    """
    _, group, count = np.unique(values, return_inverse=True, return_counts=True)
    ranks: FloatArray = np.cumsum(count) - 0.5 * (count - 1)
    return ranks[group]


def measured_scale(depth: DepthMap, witness: Witnesses, vote: ScaleVote) -> MeasuredScale:
    """Compare a measured depth with a vote in which it took no part."""
    assert depth.scale_sigma is not None
    # A stated error of 0 is that of the file's numbers: pixels and poses are not exact.
    sigma = max(depth.scale_sigma, KNOWN_SIZE_SIGMA)
    by_depth = ScaleEvidence(float(vote.residuals(witness)[0]), sigma)
    return MeasuredScale(by_depth, vote.scale.sigma or DEPTH_SCALE_SIGMA)


def rescaled_depth(
    depth: DepthMap, witness: Witnesses, vote: ScaleVote, notes: Sequence[str]
) -> DepthMap:
    """Return a metric depth at the scale of a vote in which it took part, with notes about the
    other witnesses.
    """
    factor = math.exp(-float(vote.residuals(witness)[0]))
    own = f"metric depth and people's sizes have equal weight; the depth was scaled by {factor:.3g}"
    if is_measured(depth):
        own = (
            f"the measured depth sets the scale, {1 / factor:.3g} times that of people's sizes; "
            f"these follow it"
        )
        notes = ()
    scaled = np.asarray(depth.depth * factor, np.float32)
    return replace(
        depth, depth=scaled, scale_sigma=vote.scale.sigma, notes=(*depth.notes, *notes, own)
    )
