"""Find the floor, the feet that stand on it, and the scale of the scene, once, before the metric
depth.

The three questions have one answer. Each candidate for the floor has a score by its pixels
(:mod:`physic_core.engine.ground.floor`), each foot a probability to stand
(:mod:`physic_core.engine.ground.stance`), and with both, everything of known size votes on the
scale (:mod:`physic_core.engine.sizes.scale_vote`). Camera frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from physic_core.body.bones import pose_from_parameters
from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel
from physic_core.engine.ground.carriers import carried_people
from physic_core.engine.ground.floor import (
    SOLE_SIGMA,
    FloorCandidate,
    FloorEvidence,
    GroundAtSoles,
    describe_floor,
    floor_candidates,
    standing_log_odds,
    standing_score,
)
from physic_core.engine.ground.ground_near_people import (
    RAISED_SURFACES,
    LowSkin,
    feet_pixels,
    ground_at_soles,
    low_skin,
)
from physic_core.engine.ground.lying import people_backgrounds
from physic_core.engine.ground.posture import may_rest_on_any_skin, trunk_planes_of_standing
from physic_core.engine.ground.report import (
    floor_witnesses,
    rival_note,
    scale_witnesses,
    size_notes,
    small_statures,
)
from physic_core.engine.ground.stance import Stance
from physic_core.engine.sizes.evidence import (
    USUAL_CAMERA_HEIGHT_M,
    USUAL_CAMERA_HEIGHT_SIGMA,
    USUAL_DEPTH_M,
    USUAL_DEPTH_SIGMA,
    MeasuredScale,
    depth_witness,
    is_measured,
    measured_scale,
    median_depth,
    rescaled_depth,
    scales_by_soles,
    scales_by_torsos,
)
from physic_core.engine.sizes.scale_vote import ScaleVote, Witnesses, vote_on_scale
from physic_core.engine.sizes.stature import adult_probability, stature_sigmas
from physic_core.engine.up import Up, surest_up, up_checked_by_people
from physic_core.geometry.floor import FloorSearch, PlaneFit
from physic_core.geometry.pointmap import pointmap_normals
from physic_core.geometry.tensors import exact_arrays, optional_tensors, tensor, tensors
from physic_core.types import Plane, SceneScale
from physic_core.types.arrays import PER_PERSON, select_people
from physic_core.types.observations import LEAST_PROBABILITY, POSTURES
from physic_core.types.people import GROUND_SURFACES
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.engine.photo_content import PhotoContent, PixelPoints
    from physic_core.types import (
        Bodies,
        BoolArray,
        DepthMap,
        FloatArray,
        Pointmap,
    )
    from physic_core.types.known_sizes import KnownPeople

_NO_FLOORS = (*RAISED_SURFACES, "wall", "ceiling", "window", "vegetation", "water", "sky")

# Sigmas of a scale's logarithm, beside those of a stature and of people's depth in the map. On ten
# photos with measured camera heights the height over the floor is off by .12 by soles, and by .1 by
# torsos (rms).
_FLOOR_SIGMA = 0.06  # the floor, shared by all
_TORSO_SIGMA = 0.1  # one torso
_PEOPLE_SIGMA = 0.12  # people in the map, shared by all
_TORSO_SURE = 0.9 * 0.95  # probability that a torso's scale is right, and its depth in the map
_CAMERA_SURE = 0.9  # probability that a usual camera height is right
_PEOPLE_WRONG = 0.15  # share of photos in which all people's depth is far from the scene's
_LEAST_SIZE_SIGMA = 0.01  # of a person of known stature: the pose is not exact
_LEAST_SHOWN = 0.05  # of a person, as a share of the best visible one
_NOT_ON_PLANE_NATS = -1.2  # of a person with visible soles, without a floor to stand on
_CUTS_M = 0.25  # of a body below a floor, from which on the floor is that of another surface
_NO_CAMERA_NATS = -1.0  # if there is no floor over which the camera has a height
_RESTS_UNSEEN = 0.5  # probability that people who lie do so on the floor, where nothing shows it
_LIMBS = ("shoulder", "hip", "knee", "ankle")


@dataclass(frozen=True)
class Ground(ShortRepr):
    """What carries the N people of a photo, and how large everything is.

    Attributes:
        search: the floor in the scene.
        evidence: of the photo about it.
        scale: of the scene.
        stance: of the people.
        guess_warning: warning that the scale is a guess, or "".
        is_scaled_by_people: whether the sizes of people give the scale.
        depth: the given metric depth, at this scale; None without one, and if no size of a person
            gives the scale.
        measured: scale by that depth if it was measured; this scale is then that of the people
            alone.
        small_statures: person -> stature on the floor of others, metres, of those much too small
            for an adult, until the contacts are known.
        witnesses: "floor" -> a row for each candidate: source, pitch of the camera in degrees,
            probability, and nats by witness; "scale" -> a row for each witness: whose, logarithm of
            its scale over the answer, sigma, and probability to be right.
    """

    search: FloorSearch
    evidence: FloorEvidence
    scale: SceneScale
    stance: Stance = field(metadata=PER_PERSON)
    guess_warning: str = ""
    is_scaled_by_people: bool = False
    depth: DepthMap | None = None
    measured: MeasuredScale | None = None
    small_statures: Mapping[int, float] = field(default_factory=dict)
    witnesses: Mapping[str, list[dict[str, Any]]] = field(default_factory=dict)

    @property
    def plane(self) -> Plane | None:
        """The floor in the units of the scene; None without one."""
        fit = self.search.plane
        return None if fit is None else fit.to_plane()

    def expanded(self, rows: BoolArray) -> Ground:
        """Return the ground of N people from that of those selected by ``rows`` (N,)."""
        number = np.flatnonzero(rows).tolist()
        witnesses = {
            name: [
                row | {"person": number[row["person"]]} if "person" in row else row for row in group
            ]
            for name, group in self.witnesses.items()
        }
        return replace(
            self,
            stance=self.stance.expanded(rows),
            small_statures={number[i]: stature for i, stature in self.small_statures.items()},
            witnesses=witnesses,
        )


def floor_evidence(photo: PhotoContent) -> FloorEvidence:
    """Return the evidence of segmenter, feet, camera and people who lie about the floor."""
    (floor,) = optional_tensors(photo.people.floor)
    uncovered = ~photo.masks.any(0)
    observed = photo.observations
    lie = observed.evidence("posture")[:, POSTURES.index("lie")] >= 0
    return FloorEvidence(
        mask=floor,
        hole=photo.hole,
        feet_px=tensor(feet_pixels(photo.keypoints, *photo.hole.shape)),
        other_masks=tensors(*photo.people.floor_candidates),
        ground=photo.labelled(*GROUND_SURFACES) & uncovered,
        no_ground=photo.labelled(*_NO_FLOORS) & uncovered,
        ground_at_soles=ground_at_soles(photo),
        backgrounds=people_backgrounds(select_people(photo, lie)),
        up=up_checked_in_photo(photo)[0],
        slope_sigma_deg=photo.slope_sigma_deg,
        focal_sigma=0.0 if photo.camera.known else photo.camera.focal_sigma or 0.0,
        shift_sigma=photo.scene_map.shift_sigma or 0.0,
    )


def up_checked_in_photo(photo: PhotoContent) -> tuple[Up | None, tuple[str, ...]]:
    """Return up without a floor, after the people who stand were asked, and warnings."""
    bodies = trunk_planes_of_standing(photo.keypoints, photo.observations, photo.camera)
    return up_checked_by_people(photo.up_without_floor, tensor(bodies))


def scene_floor_candidates(
    scene: PixelPoints, evidence: FloorEvidence, *, searched: bool = True
) -> tuple[FloorCandidate, ...]:
    """Return the candidates for the floor of a relative scene; only "no floor" if it is not
    searched.
    """
    if not searched:
        return (FloorCandidate(None, {}),)
    normals = pointmap_normals(scene.points, scene.valid)
    return floor_candidates(scene.points, scene.valid, evidence, normals)


def find_ground(
    photo: PhotoContent,
    bodies: Bodies,
    model: BodyModel,
    candidates: tuple[FloorCandidate, ...],
    evidence: FloorEvidence,
    depth: DepthMap | None = None,
) -> Ground:
    """Choose the floor, and find the scale of the scene and who stands.

    Args:
        photo: of N people.
        bodies: of the people.
        model: of the bodies.
        candidates: of :func:`scene_floor_candidates`.
        evidence: evidence of the photo.
        depth: metric depth of the scene with a scale of its own: it votes, too, or decides if it
            was measured.
    """
    up = surest_up(None, evidence.up, evidence.slope_sigma_deg).direction
    people = _people_evidence(photo, bodies, model, up)
    scene = photo.scene_map
    shows_ground = evidence.seen_ground is not None
    at_soles = ground_at_soles(photo, people.low_skin, up) if shows_ground else ()
    planes = [_floor_hypothesis(candidate, people, photo, at_soles) for candidate in candidates]
    scores = [sum(p.nats.values()) for p in planes]
    depth_evidence = (
        None if depth is None else depth_witness(depth, scene, photo.camera, people.torsos)
    )
    usual = Witnesses.single(USUAL_DEPTH_M / median_depth(scene), USUAL_DEPTH_SIGMA, 1.0)
    kinds = {"size": people.torsos, "usual depth of scenes": usual}
    if depth_evidence is not None and depth is not None and not is_measured(depth):
        kinds["metric depth"] = depth_evidence
    on_planes = [(p.soles, p.camera) for p in planes]
    shift_sigma = scene.shift_sigma if scene.unknown == "inverse_scale_shift" else None
    vote = vote_on_scale([*kinds.values()], on_planes, scores, shift_sigma or 0.0)
    scales_by_people = [people.torsos.scale, *(p.soles.scale for p in planes)]
    if vote is None or not np.isfinite(scales_by_people).any():
        best = int(np.argmax(scores if vote is None else vote.weights))
        search = describe_floor(candidates, best, evidence)
        scale, guess = _guessed_scale(scene, search.plane)
        return Ground(search, evidence, scale, people.stance, guess)
    ground = _ground_by_vote(vote, planes, people, kinds, evidence, photo.known)
    return (
        ground
        if depth is None or depth_evidence is None
        else _ground_with_depth(ground, depth, depth_evidence, vote)
    )


def _ground_by_vote(
    vote: ScaleVote,
    planes: Sequence[_FloorHypothesis],
    people: _PeopleEvidence,
    kinds: Mapping[str, Witnesses],
    evidence: FloorEvidence,
    known: KnownPeople,
) -> Ground:
    """Return the likeliest floor of a vote with its scale, who stands, and what speaks against
    them; ``kinds`` are the witnesses that do not depend on the floor.
    """
    candidates = tuple(p.candidate for p in planes)
    best = int(np.argmax(vote.weights))
    soles = planes[best].soles
    stance = _stance_over_floors(vote, planes, people)
    if (plane := candidates[best].plane) is not None:
        stance = stance.with_resting(people.low_skin.lowest_limbs(people.model, plane.normal))
    notes = size_notes(
        vote, soles, people.torsos, people.feet & (stance.stand_probability > LEAST_PROBABILITY)
    )
    of_plane = {"soles": soles, "usual height of cameras": planes[best].camera}
    search = describe_floor(candidates, best, evidence)
    search = _floor_below_bodies(search, people, vote.scale.scale)
    return Ground(
        _floor_at_given_soles(search, vote, soles, people.place_sigma),
        evidence,
        replace(vote.scale, notes=notes + rival_note(candidates, vote.weights, best)),
        stance,
        is_scaled_by_people=True,
        small_statures=small_statures(
            vote, soles, people.feet & (people.stance.stand_probability > LEAST_PROBABILITY), known
        ),
        witnesses={
            "floor": floor_witnesses(candidates, [p.nats for p in planes], vote.weights),
            "scale": scale_witnesses({**kinds, **of_plane}, vote),
        },
    )


def _ground_with_depth(
    ground: Ground, depth: DepthMap, witness: Witnesses, vote: ScaleVote
) -> Ground:
    """Return the ground with a metric depth at its scale; a measured one took no part in the
    vote.
    """
    measured = measured_scale(depth, witness, vote) if is_measured(depth) else None
    rescaled = rescaled_depth(depth, witness, vote, ground.scale.notes)
    return replace(ground, is_scaled_by_people=measured is None, depth=rescaled, measured=measured)


class _PeopleEvidence(NamedTuple):
    """N people and the evidence of their sizes: sigma (N,) of each size, and visible feet (N, 2)
    bool.

    ``person_probability`` (N,) is that they are people, by the segmenter, and adults; ``upright``
    (M, 55, 3) are joints of those who do not lie by the observer; ``low`` what others rest on;
    ``place_sigma`` (N,) of the logarithm of where soles are, by the user; infinite where unknown.
    """

    model: BodyModel
    vertices: FloatArray
    upright: Tensor
    feet: BoolArray
    person_probability: FloatArray
    low_skin: LowSkin
    stance: Stance
    sigma: FloatArray
    torsos: Witnesses
    place_sigma: FloatArray


def _people_evidence(
    photo: PhotoContent, bodies: Bodies, model: BodyModel, up: Tensor
) -> _PeopleEvidence:
    """Return people with their torsos as witnesses, and their stance before a floor is known, by
    up (3,) without one.
    """
    observations = photo.observations
    with torch.no_grad():
        posed = model(*pose_from_parameters(bodies.parameters, model.dtype)[:3])
    (vertices,) = exact_arrays(posed.vertices)
    observed = bodies.observed
    if observed is None:
        observed = np.ones((len(vertices), 55), bool)
    feet = np.stack(
        [observed[:, [JOINT_INDEX[f"{s}_{j}"] for j in ("ankle", "foot")]].all(1) for s in SIDES], 1
    )
    place_sigma = _place_sigmas(bodies, vertices)
    feet |= np.isfinite(place_sigma)[:, None]  # the user states where they are
    stance = Stance.in_picture(observations)
    if carriers := photo.people.carriers:
        stance = replace(stance, carried=carried_people(carriers, photo.keypoints))
    sigma, adult = _known_and_usual_sizes(photo, bodies)
    real = photo.people.scores * adult
    torsos = _size_witnesses(photo, model, vertices, sigma, real)
    lie = observations.posture[:, POSTURES.index("lie")] > LEAST_PROBABILITY
    upright = posed.joints[torch.from_numpy(~lie)]
    across = may_rest_on_any_skin(photo.keypoints, observations)
    low = low_skin(across, torch.from_numpy(vertices), model, observed, stance.holds, up)
    return _PeopleEvidence(
        model, vertices, upright, feet, real, low, stance, sigma, torsos, place_sigma
    )


def _known_and_usual_sizes(photo: PhotoContent, bodies: Bodies) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviation (N,) of the logarithm of each stature, and the probability (N,)
    that it is an adult's or stated.
    """
    sizes = photo.known.filled(len(bodies.parameters))
    sigma = _size_sigmas(photo, *sizes)
    adult = adult_probability(*sizes, photo.observations.child)
    if bodies.distance_sigma is not None:  # the user gives their size
        sigma = np.where(np.isfinite(bodies.distance_sigma), bodies.distance_sigma, sigma)
        adult = np.where(np.isnan(bodies.distance_sigma), adult, 1.0)
    return sigma, adult


def _place_sigmas(bodies: Bodies, vertices: FloatArray) -> FloatArray:
    """Return the standard deviation (N,) of the logarithm of where the soles of given bodies are;
    infinite for those without a stated place.
    """
    if bodies.distance_sigma is None or bodies.joint_sigma is None:
        return np.full(len(vertices), np.inf)
    one_axis = bodies.joint_sigma[:, 0] / math.sqrt(3)
    off = np.hypot(bodies.distance_sigma, one_axis / vertices[..., 2].mean(1))
    return np.where(np.isnan(bodies.distance_sigma), np.inf, off)


def _size_witnesses(
    photo: PhotoContent,
    model: BodyModel,
    vertices: FloatArray,
    sigma: FloatArray,
    real: FloatArray,
) -> Witnesses:
    """Return torsos as witnesses of scale, from the errors of statures and the probabilities that
    they are people (N,).
    """
    farther, spread = photo.aligned_map.people_farther or (0.0, _TORSO_SIGMA)
    scale = scales_by_torsos(
        vertices, model, photo.people.masks, photo.aligned_map, photo.camera.matrix
    )
    return Witnesses(
        scale=scale * math.exp(farther),
        depth=vertices[..., 2].mean(1),
        sigma=np.hypot(np.hypot(sigma, spread), _TORSO_SIGMA),
        right_probability=_TORSO_SURE * real,
        shared_sigma=_PEOPLE_SIGMA,
        shared_wrong=_PEOPLE_WRONG,
    )


def _size_sigmas(photo: PhotoContent, stature: FloatArray, years: FloatArray) -> FloatArray:
    """Return the standard deviation (N,) of the log size of each person, larger for less visible
    people.

    Visibility is the square root of the mask's area, times the confidence of shoulders, hips, knees
    and ankles.
    """
    keypoints = photo.keypoints
    sigma = stature_sigmas(stature, years)
    row = {name: i for i, name in enumerate(keypoints.joint_set.names)}
    used = [
        row[f"{side}_{joint}"] for side in SIDES for joint in _LIMBS if f"{side}_{joint}" in row
    ]
    confidence = np.maximum(keypoints.confidence[:, used].mean(1), 1e-3) if used else 1.0
    visible_px = np.sqrt(np.maximum(photo.people.masks.sum((1, 2)), 1)) * confidence
    share = np.maximum(visible_px / visible_px.max(initial=1e-9), _LEAST_SHOWN)
    return np.asarray(np.maximum(sigma, _LEAST_SIZE_SIGMA) / np.sqrt(share))


class _FloorHypothesis(NamedTuple):
    """A candidate for the floor: what speaks for it -> nats, by how much (N,) the ground at their
    soles leaves people on it, scales (N, 2) by the soles, and the witnesses that depend on it:
    ``soles`` (N,), of people who lie their lowest skin, and ``camera``.
    """

    candidate: FloorCandidate
    nats: Mapping[str, float]
    ground_weights: FloatArray
    by_soles: FloatArray
    soles: Witnesses
    camera: Witnesses


def _weights_by_ground(
    candidate: FloorCandidate, photo: PhotoContent, at_soles: Sequence[GroundAtSoles]
) -> FloatArray:
    """Return by how much (N,), at most 1, the ground beside their soles leaves people on a floor.

    A photo that shows no ground does not show whether they stand on something else: then the ground
    beside no soles is given.
    """
    weights = np.ones(len(photo.people))
    if candidate.plane is None:
        return weights
    plane = candidate.plane.to_plane()
    for ground in at_soles:
        rows, columns = exact_arrays(ground.rows, ground.columns)
        is_known = photo.scene_map.valid[rows, columns]
        points = photo.scene_map.points[rows, columns][is_known].astype(np.float64)
        if len(points):
            height = float(np.median(points @ plane.normal)) / plane.offset + 1
            weights[ground.person] = min(1.0, standing_log_odds(height))
    return weights


def _floor_hypothesis(
    candidate: FloorCandidate,
    people: _PeopleEvidence,
    photo: PhotoContent,
    at_soles: Sequence[GroundAtSoles],
) -> _FloorHypothesis:
    """Return the evidence of feet and camera if a candidate is the floor."""
    fit = candidate.plane
    by_soles = np.full((len(people.feet), 2), np.nan)
    by_low = np.full(len(people.feet), np.nan)
    if fit is not None and not fit.beneath:  # no sole stands on what people lie on
        by_soles = scales_by_soles(people.vertices, people.model, people.feet, fit)
        by_low = people.low_skin.scales_on_floor(fit)
    scale_by_lowest = np.where(
        people.low_skin.may_rest, by_low, np.fmax(by_soles[:, 0], by_soles[:, 1])
    )
    weights = _weights_by_ground(candidate, photo, at_soles)
    height = math.nan if fit is None else fit.offset
    return _FloorHypothesis(
        candidate,
        _floor_nats(candidate, people, scale_by_lowest),
        weights,
        by_soles,
        _soles_witness(people, scale_by_lowest, weights, at_soles),
        Witnesses.single(USUAL_CAMERA_HEIGHT_M / height, USUAL_CAMERA_HEIGHT_SIGMA, _CAMERA_SURE),
    )


def _floor_nats(
    candidate: FloorCandidate, people: _PeopleEvidence, scale_by_lowest: FloatArray
) -> dict[str, float]:
    """Return the nats of a candidate with those by the bodies of people; their lowest skin gives
    no scale (N,) if it is not below the camera.
    """
    fit = candidate.plane
    nats = dict(candidate.nats)
    if fit is None:
        nats["no height of the camera"] = _NO_CAMERA_NATS
    elif not fit.beneath:
        nats["upright people"] = standing_score(fit.normal, people.upright)
    if fit is None or not fit.beneath:
        without_scale = people.feet.any(1) & ~np.isfinite(scale_by_lowest)
        count = float(people.person_probability[without_scale].sum())
        if count:
            nats["people who are not on it"] = _NOT_ON_PLANE_NATS * count
    return nats


def _soles_witness(
    people: _PeopleEvidence,
    scale_by_lowest: FloatArray,
    ground_weights: FloatArray,
    at_soles: Sequence[GroundAtSoles],
) -> Witnesses:
    """Return the lowest skin (N,) of people as witness of the scale, sure where it is on the
    floor.
    """
    lies_on_floor = np.full(len(ground_weights), _RESTS_UNSEEN)
    for ground in at_soles:
        lies_on_floor[ground.person] = ground.stand_probability
    stands = 1 - (1 - np.where(people.feet, people.stance.stand_probability, 0.0)).prod(1)
    sure = (
        ground_weights
        * people.person_probability
        * np.where(people.low_skin.may_rest, lies_on_floor, stands)
    )
    sigma = np.hypot(people.sigma, SOLE_SIGMA)
    return Witnesses(scale_by_lowest, people.torsos.depth, sigma, sure, _FLOOR_SIGMA)


def _floor_below_bodies(search: FloorSearch, people: _PeopleEvidence, scale: float) -> FloorSearch:
    """Move a floor that cuts people whose feet are not visible down to their low ends.

    Such a plane is a table, a seat or a hedge. Visible feet show where the floor is.
    The scale is metres per unit of the scene.
    """
    plane = search.plane
    if plane is None or plane.beneath or people.feet.any() or not len(people.feet):
        return search
    low = (people.vertices @ plane.to_plane().normal.astype(float)).min(1) / people.torsos.scale
    below = -float(np.nanmedian(low)) - plane.offset if np.isfinite(low).any() else 0.0
    if below * scale < _CUTS_M:
        return search
    factor = plane.offset / (plane.offset + below)
    moved = replace(plane, offset=plane.offset + below, reanchored=plane.reanchored * factor)
    return replace(search, plane=moved)


def _floor_at_given_soles(
    search: FloorSearch, vote: ScaleVote, soles: Witnesses, place_sigma: FloatArray
) -> FloorSearch:
    """Move a floor towards the lowest skin (N,) of bodies whose place the user states, by their
    errors and that of the floor.
    """
    if search.plane is None or search.plane.beneath:
        return search
    weight = np.nan_to_num(vote.right_probability(soles)) / place_sigma**2
    if not (total := float(weight.sum())):
        return search
    lower = float(weight @ np.nan_to_num(vote.residuals(soles))) / (total + 1 / _FLOOR_SIGMA**2)
    moved = search.plane.moved(math.exp(-lower))
    return replace(search, plane=replace(moved, height_sigma=1 / math.sqrt(total)))


def _stance_over_floors(
    vote: ScaleVote, planes: Sequence[_FloorHypothesis], people: _PeopleEvidence
) -> Stance:
    """Return the stance by the probability that feet stand on each plane, at the scale of the
    vote.
    """
    stands = sum(
        weight * p.ground_weights[:, None] * np.nan_to_num(_standing_probabilities(vote, p, people))
        for weight, p in zip(vote.weights.tolist(), planes, strict=True)
    )
    rests = sum(
        weight * p.ground_weights * np.nan_to_num(vote.right_probability(p.soles))
        for weight, p in zip(vote.weights.tolist(), planes, strict=True)
    )
    rests = np.where(people.low_skin.may_rest, rests, np.nan)
    stands = np.where(people.feet, stands, people.stance.stand_probability)
    # No foot stands on a floor over which the lowest skin lies.
    return replace(
        people.stance, stand_probability=np.fmin(stands, rests[:, None]), rest_probability=rests
    )


def _standing_probabilities(
    vote: ScaleVote, plane: _FloorHypothesis, people: _PeopleEvidence
) -> FloatArray:
    """Return the probability (N, 2) that feet stand on a plane; NaN off it."""
    feet = zip(plane.by_soles.T, people.stance.stand_probability.T, strict=True)
    return np.stack(
        [
            vote.right_probability(replace(plane.soles, scale=scale, right_probability=sure))
            for scale, sure in feet
        ],
        1,
    )


def _guessed_scale(scene: Pointmap, plane: PlaneFit | None) -> tuple[SceneScale, str]:
    """Scale a scene of unknown size to a usual one; the warning names the assumption."""
    if plane is not None:
        scale = USUAL_CAMERA_HEIGHT_M / plane.offset
        assumed = f"the camera is assumed to be {USUAL_CAMERA_HEIGHT_M:g} m above the floor"
        option = "camera-height METERS"
    else:
        scale = USUAL_DEPTH_M / median_depth(scene)
        assumed = f"the median depth is assumed to be {USUAL_DEPTH_M:g} m"
        option = "known-length X1,Y1,X2,Y2,METERS"
    warning = (
        f"the scale is unknown without a person: {assumed}. To get meters, give --{option}, or use "
        "a metric depth network"
    )
    return SceneScale(scale), warning
