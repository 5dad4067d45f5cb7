"""Probability of contact: of body parts and of their vertices with scene and floor, and of vertices
with skin.

A part has one probability of contact with scene or floor, see
:mod:`physic_core.engine.ground.touch`. All its vertices share the errors of its position, so that
its distance is one number: the fifth smallest of its vertices, which is robust to outliers. A
vertex has the probability of its part, times how near it is to the surface beside the nearest
vertices of the part, and how directly its skin faces the surface. The place of a part that no pixel
shows is a guess, so its distance is ignored. It has the base rate of its kind, and feet that of the
posture and of hands that touch.

Contact with skin of another person or of the own body has the same form. The vertices of one part
that are nearest to one part of one partner share their errors, so that their fifth smallest
distance decides, as the logarithm ``log(1 + d / 1 cm)`` of the outside and the inside, with whether
one of both parts is a hand. Parts of one body that meet at a joint touch in all poses, which is no
contact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.body.posture import LYING_DEG, trunk_tilt_deg
from physic_core.engine.contact.distances import SEARCH_RADIUS_M, Distances
from physic_core.engine.contact.parts import are_adjacent, contact_regions
from physic_core.engine.ground.touch import (
    DISTANCE,
    HAND,
    HANDS,
    INSIDE,
    OBSERVED,
    OUTSIDE,
    OWN_BODY,
    SKIN,
    touch_log_odds,
    touch_model,
)
from physic_core.engine.limbs import hip_bends
from physic_core.engine.state import State
from physic_core.geometry.tensors import exact_arrays
from physic_core.types.observations import TOUCH_PARTS
from physic_core.types.skeletons import SIDES

_LOG_UNIT_M = 0.01
_GAP_VERTICES = 5

SEAT = "seat"
"""Part of buttocks and thighs: what people sit on."""

_KIND_OF = {"foot": "foot", "hand": "hand", "seat": SEAT, "upper_leg": SEAT}
_RATED = ("foot", "hand", SEAT)  # kinds whose rate is known where no pixel shows them
# What carries people who lie -> the part on its other side.
_CARRY_LYING = {"head": "head", "torso": "back", "back": "torso", SEAT: SEAT}
_SIGMA_M = 0.05  # standard deviation of the distance of a part from the scene
_MOST_BEND = 1.7  # radians; people who bend more do not sit more probably
_SHOWN_SHARE = 0.5  # of the vertices of a part that the photo shows
# Rise in metres at which half of the probability of a part is left, and power of the cosine between
# skin and surface; fitted to 155 drawn worlds.
_NEARNESS = 0.1, 3.0
_NEARNESS_OF_LIMBS = 0.05, 0.15  # of hands and feet


SUREST_VERTICES = 10
"""Number of vertices whose mean probability decides whether their body part touches."""


def mean_of_surest(vertices: Tensor) -> float:
    """Return the mean of the ten largest of the probabilities (n,) of vertices, or of all if there
    are fewer.
    """
    return float(vertices.double().topk(min(SUREST_VERTICES, len(vertices))).values.mean())


def contact_part_masks(model: BodyModel) -> dict[str, Tensor]:
    """Return the vertices (V,) bool of each body part: the contact regions, with thighs and
    buttocks as one part.
    """
    regions = contact_regions(model)
    found: dict[str, Tensor] = {}
    for number, name in enumerate(regions.names):
        part = part_of_region(name)
        chosen = (regions.region == number) & model.outer
        found[part] = found[part] | chosen if part in found else chosen
    return found


def part_of_region(region: str) -> str:
    """Return the part of a region of contacts."""
    return SEAT if kind_of_part(region) == SEAT else region


def kind_of_part(part: str) -> str:
    """Return the kind of a part: "foot", "hand", "seat" or "other"; parts of one kind have one
    model.
    """
    return _KIND_OF.get(part.removeprefix("left_").removeprefix("right_"), "other")


def scene_contact(state: State, near: Distances) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Return the probability (N, V) that the parts of vertices touch scene or floor, that of the
    vertices, and that of each part: name -> (N,).
    """
    at = near_scene(state, near)
    unseen = unseen_parts(state, near)
    lies = _lying_people(state)
    parts = {}
    of_parts = part_features(state, at.gap)
    hands = torch.zeros_like(state.joints[:, 0, 0])
    # hands first
    for name in sorted(of_parts, key=lambda part: kind_of_part(part) != "hand"):
        features = of_parts[name] | {HANDS: hands}
        kind = kind_of_part(name)
        odds = touch_log_odds(kind, features)
        if kind in _RATED:
            odds = torch.where(unseen[name], touch_log_odds(f"unseen {kind}", features), odds)
        if name in _CARRY_LYING:
            distance = features[DISTANCE]
            beneath = distance <= of_parts[_CARRY_LYING[name]][DISTANCE]
            odds = torch.where(lies & beneath, _odds_of_feet(distance), odds)
        parts[name] = torch.sigmoid(odds)
        if kind == "hand":
            hands = hands.maximum(parts[name])
    parts = {name: parts[name] for name in of_parts}
    of_vertex = torch.stack(list(parts.values()), 1)[:, _part_of_vertex(state.model)]
    return of_vertex, of_vertex * _vertex_share(state.model, at.rise, at.facing), parts


def _lying_people(state: State) -> Tensor:
    """Return whether the trunk of each person (N,) bool is nearly horizontal."""
    tilt = trunk_tilt_deg(*exact_arrays(state.joints, state.up))
    return torch.as_tensor(np.abs(tilt - 90.0) < LYING_DEG).to(state.joints.device)


def _odds_of_feet(distance: Tensor) -> Tensor:
    """Return the log odds of parts that carry people who lie, as feet carry people who stand."""
    unknown = dict.fromkeys(touch_model()["foot"], torch.zeros_like(distance))
    return touch_log_odds("foot", unknown | {DISTANCE: distance})


def unseen_parts(state: State, near: Distances) -> dict[str, Tensor]:
    """Return part -> (N,) bool: no pixel shows the part, nor a confident keypoint at its end."""
    shown = state.visible_vertices | near.in_mask
    parts = contact_part_masks(state.model)
    return {
        name: shown[:, chosen].double().mean(1) < _SHOWN_SHARE for name, chosen in parts.items()
    }


class NearScene(NamedTuple):
    """Distances of N people's parts and vertices from the scene.

    Attributes:
        gap: (N, P) signed distance of each part of :func:`contact_part_masks`, metres; inf if
            nothing is near.
        rise: (N, V) how much farther the vertex is than its part, metres, at least 0; inf if it is
            far.
        facing: (N, V) cosine between the skin and the surface that it faces.
    """

    gap: Tensor
    rise: Tensor
    facing: Tensor


def near_scene(state: State, near: Distances) -> NearScene:
    """Return where vertices are beside scene and floor.

    A part with nothing near it is compared with a level surface under its lowest vertices.
    """
    distance, facing = _scene_distance_and_facing(state, near)
    height = torch.where(state.model.outer, state.vertices @ state.up, torch.inf)
    group = _part_of_vertex(state.model)
    gap = _gaps_of_parts(state.model, distance)
    lowest = _gaps_of_parts(state.model, height)
    lost = torch.isinf(gap)[:, group]
    rise = torch.where(lost, height - lowest[:, group], distance - gap[:, group])
    return NearScene(gap, torch.relu(rise), torch.where(lost, -(near.normals @ state.up), facing))


def _vertex_share(model: BodyModel, rise: Tensor, facing: Tensor) -> Tensor:
    """Return the share (N, V) of the probability of a part that its vertices have.

    Args:
        model: of the bodies.
        rise: (N, V) how much farther the vertex is than its part, metres.
        facing: (N, V) cosine between the skin and the surface that it faces.
    """
    limbs = model.on_parts("hand", "foot")
    far_m, power = (
        torch.where(limbs, of_limbs, otherwise)
        for of_limbs, otherwise in zip(_NEARNESS_OF_LIMBS, _NEARNESS, strict=True)
    )
    return ((1 + facing) / 2) ** power / (1 + (rise / far_m).square())


def part_features(state: State, gap: Tensor) -> dict[str, dict[str, Tensor]]:
    """Return part -> name of a feature -> values (N,): one reason for or against contact of the
    part with the scene.

    "distance" is that of the part in standard deviations, 0 inside, and at most that of the search
    radius. "observed" is that of the person observer. "bend at the hips" is the smaller angle
    between trunk and thighs, radians; 0 is straight.

    Args:
        state: bodies, and what the photo shows of them.
        gap: (N, P) distance of each part, metres; inf if nothing is near.
    """
    joints = state.joints
    observed = state.observed_touch
    if observed is None:
        observed = joints.new_zeros(len(joints), len(TOUCH_PARTS))
    bend = hip_bends(joints).amin(1).clamp(max=_MOST_BEND).nan_to_num()
    found: dict[str, dict[str, Tensor]] = {}
    for name, own in zip(contact_part_masks(state.model), gap.T, strict=True):
        found[name] = {DISTANCE: torch.relu(own).clamp(max=SEARCH_RADIUS_M) / _SIGMA_M}
        side = SIDES.index(name.partition("_")[0]) if name.startswith(SIDES) else 0
        column = {"foot": side, "hand": 2 + side, SEAT: 4}.get(kind_of_part(name))
        if column is not None:
            found[name][OBSERVED] = observed[:, column]
    found[SEAT]["bend at the hips"] = bend
    return found


def _gaps_of_parts(model: BodyModel, distance: Tensor) -> Tensor:
    """Return the fifth smallest of the distances (N, V) of each part, (N, P)."""
    parts = contact_part_masks(model).values()
    return torch.stack([distance[:, chosen].kthvalue(_GAP_VERTICES).values for chosen in parts], 1)


def _part_of_vertex(model: BodyModel) -> Tensor:
    """Return the row (V,) int64 of the part of each vertex in :func:`contact_part_masks`; 0 for
    inner vertices.
    """
    parts = torch.stack(list(contact_part_masks(model).values()))
    return parts.int().argmax(0)


def _scene_distance_and_facing(state: State, near: Distances) -> tuple[Tensor, Tensor]:
    """Return the distance (N, V) of outer vertices to scene or floor, and the cosine (N, V) with
    which they face it.

    The floor's plane is fitted to many points, so it gives the distance to the floor within reach.
    """
    surface = near.surface
    by_plane = surface.on_floor | (near.on_ground & torch.isfinite(surface.floor))
    distance = torch.where(by_plane, surface.floor, surface.scene)
    towards = torch.where(by_plane[..., None], state.up, surface.normals)
    return torch.where(state.model.outer, distance, torch.inf), -(near.normals * towards).sum(-1)


def skin_contact(state: State, near: Distances) -> tuple[Tensor, Tensor]:
    """Return the probability (2, N, V) that the part of a vertex touches the part of another
    person, and of the own body, to which the vertex is nearest; and that of the vertex.
    """
    of_parts = []
    of_vertices = []
    for skin, at in zip((near.people, near.own), near_skin(state, near), strict=True):
        touches = torch.isfinite(at.gap)
        odds = touch_log_odds(SKIN, at.features)
        sure = torch.where(touches, torch.sigmoid(odds), 0.0)
        facing = -(near.normals * near.normals[skin.person, skin.vertex]).sum(-1)
        rise = torch.where(touches, skin.distance - at.gap, 0.0)
        of_parts.append(sure)
        of_vertices.append(sure * _vertex_share(state.model, torch.relu(rise), facing))
    return torch.stack(of_parts), torch.stack(of_vertices)


class NearSkin(NamedTuple):
    """Distances of N people's vertices from skin.

    Attributes:
        gap: (N, V) signed distance of the part of the vertex from the part to which the vertex is
            nearest, metres; inf if no skin is near, or if both parts meet at a joint.
        features: of :data:`SKIN`, name -> (N, V).
    """

    gap: Tensor
    features: dict[str, Tensor]


def near_skin(state: State, near: Distances) -> tuple[NearSkin, NearSkin]:
    """Return where vertices are beside the skin of other people, and of their own bodies."""
    names, region = contact_regions(state.model)
    hands = state.model.on_parts("hand")
    meet = torch.tensor(
        [[one == other or are_adjacent(one, other) for other in names] for one in names]
    )
    found = []
    for skin, is_own in ((near.people, False), (near.own, True)):
        other = region[skin.vertex]
        distance = skin.distance
        if is_own:
            distance = torch.where(meet.to(other.device)[region, other], torch.inf, distance)
        pair = (region * len(names) + other) * len(state.vertices) + skin.person
        gap = part_gaps(distance, pair)
        finite = torch.where(torch.isfinite(gap), gap, SEARCH_RADIUS_M)
        found.append(
            NearSkin(
                gap,
                {
                    OUTSIDE: _log_cm(finite),
                    INSIDE: _log_cm(-finite),
                    HAND: (hands | hands[skin.vertex]).to(finite),
                    OWN_BODY: torch.full_like(finite, is_own),
                },
            )
        )
    return found[0], found[1]


def part_gaps(distance: Tensor, group: Tensor) -> Tensor:
    """Return the gap (N, V) of the group of each vertex: the fifth smallest of its finite
    distances; inf without any.

    Args:
        distance: (N, V) signed, metres; inf where nothing is near.
        group: (N, V) int64; vertices of one person and group share their errors.
    """
    gaps = torch.full_like(distance, torch.inf)
    for own, number, gap in zip(distance.detach(), group, gaps, strict=True):
        order = torch.isfinite(own).nonzero()[:, 0]
        order = order[own[order].argsort(stable=True)]
        order = order[number[order].argsort(stable=True)]
        _, inverse, count = number[order].unique_consecutive(
            return_inverse=True, return_counts=True
        )
        fifth = count.cumsum(0) - count + count.clamp(max=_GAP_VERTICES) - 1
        gap[order] = own[order][fifth[inverse]]
    return gaps


def _log_cm(distance: Tensor) -> Tensor:
    """Return log(1 + d / 1 cm) of the positive part of distances in metres."""
    return torch.log1p(torch.relu(distance) / _LOG_UNIT_M)
