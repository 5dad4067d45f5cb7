"""Contact of the reconstructed people: per vertex, by body part, and the numbers that checks need."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isinf
from typing import TYPE_CHECKING

import torch

from physic_core.engine.contact.carrying_surfaces import correct_carrying_classes
from physic_core.engine.contact.dents import above_dents, dent_depths, give_of_points
from physic_core.engine.contact.distance import (
    SEARCH_RADIUS_M,
    ContactSurfaces,
    SurfaceDistances,
    contact_surfaces,
    surface_distances,
)
from physic_core.engine.contact.floor_points import combine_floor_points
from physic_core.engine.contact.inpainted_surfaces import lower_to_parts
from physic_core.engine.contact.objects import ObjectDistances, object_distances, object_probability
from physic_core.engine.contact.partner import ContactPartners, assign_partners, body_contacts
from physic_core.engine.contact.probability import (
    ASSUMED,
    FLOOR,
    LIFTED_FOOT,
    OWN_HAND,
    PERSON,
    SCENE,
    SELF,
    STRAIGHT_HIP,
    SURFACES,
    contact_probability,
    facing_probability,
)
from physic_core.engine.contact.regions import contact_regions
from physic_core.engine.contact.scene_parts import ClassifiedPoints, SceneParts, scene_parts
from physic_core.engine.contact.skin import (
    SkinContacts,
    SkinDistances,
    own_contact_seen,
    own_distances,
    people_distances,
    without_shared_gap,
)
from physic_core.engine.contact.straight_hips import arms_at_straight_hips
from physic_core.engine.contact.support import (
    DOWNWARD,
    Carried,
    ContactEvidence,
    PosedPerson,
    find_support,
    support_record,
    with_support,
)
from physic_core.engine.joint.distances import plane_height
from physic_core.engine.joint.limbs import observed_parts
from physic_core.engine.joint.solve import DEEP_M
from physic_core.geometry.free_space import front_depth, in_free_space
from physic_core.geometry.tensors import tensor
from physic_core.geometry.visibility import vertex_normals
from physic_core.pipeline.measures import clearance, depth_ratio, sole_height, support_gap, visible_share
from physic_core.pipeline.silhouettes import PhotoEvidence, compare_silhouettes
from physic_core.types.contacts import NO_PARTNER

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.engine.joint.problem import JointProblem, JointResult
    from physic_core.engine.scene.build import SceneState
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.types import BodyContact, Support

__all__ = ["Contacts", "classify_points", "measure_contacts"]

_SEAT, _HELD = 1, 2  # assumed supports, as in assign_partners
_SCENE, _PEOPLE, _OWN_BODY = 0, 1, 2  # what a vertex touches; the scene is with the floor
_UNSEEN_THRESHOLD = 0.5  # of contact of limbs that the photo does not show, at least
_UNKNOWN_PRIOR = 0.5  # a contact prior gives 0 to what it does not see
_OWN_RADIUS_M = 0.08  # of the search on the own body, whose parts are off by less than scene and people


@dataclass(frozen=True)
class Contacts:
    """Contacts of N people.

    Attributes:
        contact: (N, V) bool.
        probability: (N, V) of contact with anything; None if the preset's rule is the distance.
        distance: (N, V) signed distance to scene and floor, metres; inf beyond the search radius.
        partners: of the contact vertices.
        by_part: per person, contacts by body part.
        measures: per person, measured numbers by name.
        supports: per person, what carries them; None for non-finite vertices.
    """

    contact: Tensor
    probability: Tensor | None
    distance: Tensor
    partners: ContactPartners
    by_part: tuple[tuple[BodyContact, ...], ...]
    measures: list[dict[str, float | None]]
    supports: tuple[Support | None, ...]


def classify_points(estimates: Estimates, scene: SceneState) -> ClassifiedPoints:
    """Return the classes of the valid scene points, all unknown if the segmenter labels no surfaces."""
    surfaces, seen = estimates.people.surfaces, ~tensor(estimates.hole)[scene.valid]
    uncarved = None if scene.uncarved is None else (scene.uncarved[0][scene.valid], scene.uncarved[1][scene.valid])
    if surfaces is None:
        return ClassifiedPoints(("unknown",), torch.zeros_like(seen, dtype=torch.int64), seen, uncarved)
    return ClassifiedPoints(surfaces.names, tensor(surfaces.labels).long()[scene.valid], seen, uncarved)


def measure_contacts(
    problem: JointProblem,
    result: JointResult,
    settings: EngineSettings,
    classes: ClassifiedPoints,
    objects: Tensor,
) -> Contacts:
    """Compute contacts of all people, and the measures of each.

    People with non-finite vertices get no contacts and infinite distance.

    Args:
        problem: with the final scene.
        result: of stage 3.
        settings: of the engine.
        classes: of ``problem.scene_points``.
        objects: (K, H, W) bool, visible pixels of objects in hands and on laps.
    """
    s, model = result.scene_scale, problem.model
    finite = torch.isfinite(result.vertices).flatten(1).all(1)
    rows = finite.nonzero(as_tuple=True)[0]
    contact = torch.zeros(result.vertices.shape[:2], dtype=torch.bool, device=result.vertices.device)
    distance = torch.full_like(result.vertices[..., 0], torch.inf)
    index = torch.full(contact.shape, NO_PARTNER, dtype=torch.int16, device=contact.device)
    by_probability = settings.contact.rule == "probability"
    probability = torch.zeros_like(distance) if by_probability else None
    measured: list[dict[str, float | None]] = [{} for _ in finite]
    if not len(rows):
        nobody = ContactPartners((), index), ((),) * len(finite), measured, (None,) * len(finite)
        return Contacts(contact, probability, distance, *nobody)
    vertices = result.vertices[rows]
    outward = vertex_normals(vertices, model.faces)
    in_air = problem.feet_in_air()[rows]
    may_touch = model.outer & ~in_air
    seen_limbs = observed_parts(model.part_names, problem.observed[rows])[:, model.part_of_vertex]
    supports = may_touch & seen_limbs if by_probability else may_touch
    plane = None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * s)
    around = contact_surfaces(problem, vertices, s, settings)
    free = None
    if settings.joint.energy_options.free_space and problem.scene_depth is not None:
        free = in_free_space(vertices / s, front_depth(problem.scene_depth), problem.K)
    near = surface_distances(vertices, around.scene, around.floor, settings.contact, free)
    distance[rows] = near.nearest
    above = None
    if plane is not None:
        above = plane_height(around.scene.points, plane[0].to(vertices), vertices.new_tensor(plane[1]))
    parts = scene_parts(around.scene.points, around.scene.normals, around.row, classes, above)
    give = _give(near, parts)
    before = _before_move(problem, vertices, s, settings, classes)
    known = combine_floor_points(near, parts) if by_probability else near
    inpainted = _inpainted(known, around, classes)
    scene = lower_to_parts(known.scene, before.distance, before.normals, give, inpainted, model.part_of_vertex)
    skin = _skin_distances(model, vertices, outward, settings)
    touches, touched, likely = _touching(
        model,
        replace(
            known,
            scene=above_dents(scene if by_probability else near.scene, give),
            floor=above_dents(known.floor, give),
        ),
        skin,
        torch.where(arms_at_straight_hips(model, result.joints[rows], skin[1].vertex), STRAIGHT_HIP, 1.0),
        may_touch,
        model.outer * torch.where(in_air, LIFTED_FOOT, 1.0),
        seen_limbs,
        _surface_kinds(known, around),
        _facing(known, around, outward, plane),
        problem.contact_probability[rows],
        settings,
    )
    soft = _share_below_dents(result, rows, give)
    ratio = _depth_ratios(problem, vertices, outward, rows, s)
    on_object = torch.full(touches.shape, -1, dtype=torch.int64, device=touches.device)
    to_objects = _held_objects(problem, vertices, objects, ratio, s, settings)
    if to_objects is not None and likely is not None:
        by_object = object_probability(to_objects, may_touch, seen_limbs, settings.contact)
        nearest = to_objects.distance.abs() < torch.minimum(near.nearest.abs(), skin[0].distance.abs())
        on_object = torch.where((by_object >= settings.contact.threshold) & nearest, to_objects.object, on_object)
        touches, likely = touches | (on_object >= 0), 1 - (1 - likely) * (1 - by_object)
    hidden = torch.zeros(touches.shape, dtype=torch.int64, device=touches.device)
    carried: dict[int, Carried] = {}
    up, height = plane or (vertices.new_tensor([0.0, -1.0, 0.0]), None)
    up = up.to(vertices)
    soles = torch.cat([model.contact_sets["left_sole"], model.contact_sets["right_sole"]])
    silhouettes = compare_silhouettes(result.vertices, model.faces, _photo_evidence(problem, s))
    for row, (i, body, normals) in enumerate(zip(rows.tolist(), vertices, outward, strict=True)):
        seen = problem.masks[i]
        posed = PosedPerson(body, normals, result.joints[i], result.rotations[i])
        lifted = problem.lifted_feet[i] if problem.lifted_feet is not None else torch.zeros(2, dtype=torch.bool)
        outward_contact = touches[row] & (touched[row] != _OWN_BODY) & (on_object[row] < 0)
        prior = _known_prior(problem.contact_probability[i], seen_limbs[row])
        evidence = ContactEvidence(
            contact=outward_contact,
            may_touch=may_touch[row],
            distance=near.nearest[row],
            prior=prior,
            lifted_feet=lifted,
            seen=seen_limbs[row],
            hanging=bool(result.hanging[i]),
        )
        carried[i] = find_support(model, posed, evidence, up, assume=settings.contact.assume_supports)
        hidden[row, carried[i].hidden] = _SEAT if carried[i].hidden_is_seat else _HELD
        measured[i] |= {
            "balance_m": None if isinf(carried[i].outside_m) else max(0.0, carried[i].outside_m),
            "assumed_support": float(carried[i].hidden.any()),
            **silhouettes[i],
            "clearance_m": clearance(body, distance[i], up, height),
            "sole_height_m": sole_height(body, soles, up, height),
            "seen_share": visible_share(body, normals, model.faces, model.outer, seen, problem.K),
            "support_gap_m": support_gap(
                body, result.joints[i], normals, supports[row], distance[i], up, height, SEARCH_RADIUS_M
            ),
        }
        if problem.human_depth is not None:
            measured[i]["depth_ratio"] = ratio[row]
        if "penetration_share" in result.diagnostics[i]:
            measured[i]["penetration_share"] = soft[row]
    contact[rows] = touches | (hidden > 0)
    if probability is not None and likely is not None:
        likely = torch.where(hidden > 0, likely.clamp(min=ASSUMED), likely)
        probability[rows] = likely
    under = touches & (touched == _SCENE) & (on_object < 0) & torch.isfinite(near.scene) & (outward @ up < DOWNWARD)
    carrying = torch.zeros_like(parts.ground)
    carrying[near.point[under].to(carrying.device)] = True
    named = correct_carrying_classes(parts, around.scene.points, carrying, above)
    names, region = contact_regions(model)
    on_people, on_self = (
        SkinContacts((touched == kind) & (on_object < 0), replace(one, person=rows[one.person]))
        for kind, one in zip((_PEOPLE, _OWN_BODY), skin, strict=True)
    )
    partners = assign_partners(contact[rows], near, named, on_people, on_self, hidden, on_object, names, region)
    index[rows] = partners.index
    of_scene = torch.tensor([*(one.kind in ("floor", "scene") for one in partners.table), False], device=index.device)
    dents = torch.full_like(distance, torch.nan)
    dent = _dents(before, around, parts, len(problem.scene_points))
    dents[rows] = torch.where(of_scene[partners.index.long()], dent, torch.nan)
    by_part = tuple(
        body_contacts(
            own,
            None if probability is None else probability[i],
            partners.table,
            names,
            region,
            dent=deep,
            least=settings.contact.threshold,
        )
        for i, (own, deep) in enumerate(zip(index, dents, strict=True))
    )
    supports_of = tuple(
        support_record(carried[i], own, None if probability is None else probability[i], partners.table, names, region)
        if i in carried
        else None
        for i, own in enumerate(index)
    )
    by_part = tuple(
        own if support is None else with_support(own, support)
        for own, support in zip(by_part, supports_of, strict=True)
    )
    table = ContactPartners(partners.table, index)
    return Contacts(contact, probability, distance, table, by_part, measured, supports_of)


def _known_prior(prior: Tensor, seen: Tensor) -> Tensor:
    """Return the prior (V,) with a low probability of limbs that the photo does not show replaced by an unknown one."""
    return torch.where(seen, prior, prior.clamp(min=_UNKNOWN_PRIOR))


def _share_below_dents(result: JointResult, rows: Tensor, give: Tensor) -> list[float]:
    """Return the share of each person's visible surface over 3 cm below scene and floor, dented by ``give`` (N, V)."""
    deep = result.depth_inside[rows] > DEEP_M + give.to(result.depth_inside)
    shares: list[float] = (result.surface_share[rows] * deep).sum(1).tolist()
    return shares


def _give(near: SurfaceDistances, parts: SceneParts) -> Tensor:
    """Return the largest depth (N, V) of a dent of the surface nearest to each vertex; 0 where none is near."""
    if not len(parts.label):
        return torch.zeros_like(near.scene)
    return torch.where(torch.isfinite(near.scene), give_of_points(parts).to(near.scene)[near.point], 0.0)


@dataclass(frozen=True)
class _SceneBeforeMove:
    """Distances to the scene before stage 3 moved inpainted points out of people.

    Attributes:
        distance: (N, V) signed, metres; inf beyond the search radius.
        row: (N, V) int64, row of the nearest point in ``JointProblem.scene_points``; -1 beyond the search radius.
        normals: (N, V, 3) unit, of that point; zero beyond the search radius.
    """

    distance: Tensor
    row: Tensor
    normals: Tensor


def _before_move(
    problem: JointProblem, vertices: Tensor, scale: float, settings: EngineSettings, classes: ClassifiedPoints
) -> _SceneBeforeMove:
    """Return the distances of vertices (N, V, 3) to the scene before inpainted points were moved out of people."""
    points, normals = classes.uncarved or (problem.scene_points, problem.scene_normals)
    before = replace(problem, scene_points=points.to(vertices), scene_normals=normals.to(vertices), floor_normal=None)
    surfaces = contact_surfaces(before, vertices, scale, settings)
    found = surface_distances(vertices, surfaces.scene, None, settings.contact)
    near = torch.isfinite(found.scene)
    row = torch.full_like(found.point, -1)
    row[near] = surfaces.row[found.point[near]]
    normal = torch.zeros_like(vertices)
    normal[near] = surfaces.scene.normals[found.point[near]].to(vertices)
    return _SceneBeforeMove(found.scene, row, normal)


def _dents(before: _SceneBeforeMove, around: ContactSurfaces, parts: SceneParts, points: int) -> Tensor:
    """Return the depth (N, V) of the dent at each vertex, metres; NaN where nothing gives way.

    Args:
        before: distances to the scene before inpainted points were moved out of people.
        around: surfaces near people.
        parts: of the points of ``around``.
        points: number of scene points.
    """
    own = around.row >= 0
    give = before.distance.new_zeros(points + 1)  # the last is that of row -1
    give[around.row[own]] = give_of_points(parts).to(give)[own]
    allowed = give[before.row]
    return torch.where(allowed > 0, dent_depths(before.distance, allowed), torch.nan)


def _depth_ratios(
    problem: JointProblem, vertices: Tensor, outward: Tensor, rows: Tensor, scale: float
) -> list[float | None]:
    """Return the depth of the photo over that of each body; None where it cannot be measured."""
    if problem.human_depth is None:
        return [None] * len(rows)
    depth, outer, K = problem.human_depth * scale, problem.model.outer, problem.K
    return [
        depth_ratio(body, normals, outer, mask, K, depth)
        for body, normals, mask in zip(vertices, outward, problem.masks[rows], strict=True)
    ]


def _held_objects(
    problem: JointProblem,
    vertices: Tensor,
    objects: Tensor,
    ratio: list[float | None],
    scale: float,
    settings: EngineSettings,
) -> ObjectDistances | None:
    """Return the distances of vertices (N, V, 3) to objects; None if people touch none, or their depth is unknown."""
    if not len(objects) or problem.human_depth is None or settings.contact.rule == "distance":
        return None
    nearer = vertices.new_tensor([torch.nan if one is None else 1 / one for one in ratio])
    depth = problem.human_depth * scale
    return object_distances(vertices, objects.to(depth.device), depth, nearer, problem.K, SEARCH_RADIUS_M)


def _inpainted(near: SurfaceDistances, around: ContactSurfaces, classes: ClassifiedPoints) -> Tensor:
    """Return the vertices (N, V) bool whose nearest surface is an inpainted point of the scene."""
    if not len(around.row):
        return torch.zeros_like(near.on_floor)
    row = around.row[near.point]
    return (row >= 0) & ~classes.seen.to(row.device)[row] & ~near.on_floor


def _surface_kinds(near: SurfaceDistances, around: ContactSurfaces) -> Tensor:
    """Return the kind (N, V) of the surface nearest to each vertex, as in :func:`contact_probability`."""
    floor = near.on_floor
    if len(around.row):
        floor = floor | (around.row[near.point] < 0)
    return torch.where(floor, SURFACES.index(FLOOR), SURFACES.index(SCENE))


def _facing(
    near: SurfaceDistances, around: ContactSurfaces, outward: Tensor, plane: tuple[Tensor, float] | None
) -> Tensor:
    """Return the cosine (N, V) between each vertex's inward normal and the nearest surface's; NaN if that has none."""
    towards = torch.zeros_like(outward)
    if len(around.row):
        towards = around.scene.normals[near.point].to(outward)
    if plane is not None:
        towards = torch.where(near.on_floor[..., None], plane[0].to(outward), towards)
    known = towards.square().sum(-1) > 0.5
    return torch.where(known, -(outward * towards).sum(-1), torch.nan)


def _skin_distances(
    model: BodyModel, vertices: Tensor, normals: Tensor, settings: EngineSettings
) -> tuple[SkinDistances, SkinDistances]:
    """Return the distances to other people and to the own body (N, V) each, inf if the settings exclude them."""
    if not settings.contact.people:
        index = torch.zeros(vertices.shape[:2], dtype=torch.int64, device=vertices.device)
        none = SkinDistances(torch.full_like(vertices[..., 0], torch.inf), index, index)
        return none, none
    rest = model(*model.zero_pose()).vertices[0]
    return (
        people_distances(vertices, normals, model.outer, SEARCH_RADIUS_M),
        own_distances(vertices, normals, model.outer, model.part_of_vertex, rest, _OWN_RADIUS_M),
    )


def _touching(
    model: BodyModel,
    near: SurfaceDistances,
    skin: tuple[SkinDistances, SkinDistances],
    own_chance: Tensor,
    may_touch: Tensor,
    chance: Tensor,
    seen_limbs: Tensor,
    kinds: Tensor,
    facing: Tensor,
    prior: Tensor,
    settings: EngineSettings,
) -> tuple[Tensor, Tensor, Tensor | None]:
    """Return vertices in contact, what they touch (0 scene, 1 people, 2 own body), and the probability: (N, V) each.

    Args:
        model: body model.
        near: distances to scene and floor.
        skin: distances to other people and to the own body.
        own_chance: (N, V) factor on the probability of contact with the own body.
        may_touch: (N, V) bool, vertices that may be in contact by distance.
        chance: (N, V) factor on the probability.
        seen_limbs: (N, V) bool, vertices of limbs that the photo shows.
        kinds: (N, V) int64, of the nearest surface.
        facing: (N, V) cosine between inward normal of the skin and normal of that surface; NaN where it has none.
        prior: (N, V) of the contact prior.
        settings: of the engine.
    """
    reach = settings.contact
    if reach.rule == "distance":
        distances = torch.stack([near.nearest, *(one.distance for one in skin)])
        within = (distances <= reach.distance_m) & (distances >= -reach.inside_m) & may_touch
        return within.any(0), torch.where(within, distances.abs(), torch.inf).argmin(0), None
    people, own = skin
    part = model.part_of_vertex
    hands = torch.tensor([name.endswith("hand") for name in model.part_names], device=part.device)[part]
    thin = torch.tensor([name.endswith(("hand", "foot")) for name in model.part_names], device=part.device)[part]
    faces = torch.where(thin, 1.0, facing_probability(facing))
    on_person = torch.full_like(kinds, SURFACES.index(PERSON))
    on_own = torch.where(hands | hands[own.vertex], SURFACES.index(OWN_HAND), SURFACES.index(SELF))
    seen_on_own = own_contact_seen(seen_limbs, hands, own.vertex)
    probabilities = torch.stack(
        [
            contact_probability(near.nearest, kinds, seen_limbs, prior, reach) * faces,
            contact_probability(without_shared_gap(people, part), on_person, seen_limbs, None, reach),
            contact_probability(own.distance, on_own, seen_on_own, None, reach) * own_chance,
        ]
    )
    likely = (1 - (1 - probabilities).prod(0)) * chance
    skin_likely = probabilities[1:].amax(0) * chance
    touched = probabilities.argmax(0)
    on_skin = (skin_likely >= reach.skin_threshold) & (touched > 0)
    # Where the photo does not show a limb, the pose is a guess: contact with the scene is stated if it is more likely
    # than not, and contact with skin is not.
    seen = torch.where(touched == _OWN_BODY, seen_on_own, seen_limbs)
    likely_hidden = (likely >= max(_UNSEEN_THRESHOLD, reach.threshold)) & (touched == _SCENE)
    return (((likely >= reach.threshold) | on_skin) & seen) | likely_hidden, touched, likely


def _photo_evidence(problem: JointProblem, scale: float) -> PhotoEvidence:
    """Return masks and depths of the problem, with the final scale of the scene."""
    scene, photo = problem.scene_depth, problem.human_depth
    return PhotoEvidence(
        masks=problem.masks,
        scene_depth=None if scene is None else scene * scale,
        photo_depth=None if photo is None else photo * scale,
        K=problem.K,
    )
