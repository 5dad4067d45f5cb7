"""Probability of contact: of body parts and of their vertices with scene and floor, of hands with
objects, and of vertices with skin.

A part has one probability of contact with scene or floor, see
:mod:`physic_core.engine.ground.touch`. Where the person observer speaks of it, it is what it says.
Of other feet and buttocks distance decides: all vertices of a part share the errors of its
position, so that its distance is one number, the fifth smallest of its vertices, which is robust to
outliers. All other parts, and those that nothing shows, have the share of their kind: distance
tells no more of them.

The ten surest vertices of a part have its probability. The others have less of it, the farther they
are from the surface beside these, and the less directly their skin faces it.

Contact with skin of another person or of the own body is what the observer says of a part, with the
part that :mod:`physic_core.engine.skin_contact` tells, and of this part the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.body.posture import LYING_DEG, trunk_tilt_deg
from physic_core.engine.body_parts import OBSERVED, SEAT, contact_regions
from physic_core.engine.contact.distances import SEARCH_RADIUS_M, Distances
from physic_core.engine.ground.touch import touch_by_distance, world_touch_rate
from physic_core.engine.state import State
from physic_core.geometry.tensors import exact_arrays
from physic_core.types.observations import TOUCHED
from physic_core.types.skeletons import SIDES

_GAP_VERTICES = 5
# Least cosine between down and the skin of a back on which a person lies. On 67 pictures of
# exercises the backs of all 21 who lie on their backs with the seat touch, too.
_FACES_DOWN = 0.5
# Height of a head over a back from which on it does not rest beside it. On 34 of these pictures the
# heads of nine that do are at most 8 cm higher, and that of one who crunches 17.
_HEAD_M = 0.12

BACK = "back"
"""Part on which people lie."""

HEAD = "head"
"""Part that what carries the back may carry."""

_SIGMA_M = 0.05  # standard deviation of the distance of a part from the scene
# Rise in metres at which half of the probability of a part is left, and power of the cosine between
# skin and surface; fitted to 155 drawn worlds.
_NEARNESS = 0.1, 3.0
_NEARNESS_OF_LIMBS = 0.05, 0.15  # of hands and feet

LARGEST_VERTICES = 10
"""Number of vertices whose mean probability is that of their body part."""


def mean_of_largest(probabilities: Tensor) -> float:
    """Return the mean of the ten largest of the probabilities (n,) of vertices, or of all if there
    are fewer.
    """
    return float(
        probabilities.double().topk(min(LARGEST_VERTICES, len(probabilities))).values.mean()
    )


def contact_part_masks(model: BodyModel) -> dict[str, Tensor]:
    """Return the outer vertices (V,) bool of each body part."""
    regions = contact_regions(model)
    return {
        name: (regions.region == number) & model.outer for number, name in enumerate(regions.names)
    }


def scene_contact_probability(state: State, near: SceneProximity) -> dict[str, Tensor]:
    """Return part -> probability (N,) that it touches scene or floor."""
    probabilities = {}
    gaps = part_gap_sigmas(state.model, near)
    for name, hidden in hidden_parts(state).items():
        by_distance = touch_by_distance(name, gaps[name])
        by_distance = torch.where(hidden, world_touch_rate(name), by_distance)
        observed = observed_touch(state, name, "world")
        probabilities[name] = torch.where(observed.isnan(), by_distance, observed)
    # What a person who lies on the seat lies on carries the back, too, and a head as low.
    names = list(contact_part_masks(state.model))
    back, head = names.index(BACK), names.index(HEAD)
    lies = is_lying(state) & (near.down[:, back] > _FACES_DOWN)
    probabilities[BACK] = torch.where(
        lies, torch.maximum(probabilities[BACK], probabilities[SEAT]), probabilities[BACK]
    )
    lowest = _lowest_heights(state)
    head_is_low = lies & (lowest[:, head] - lowest[:, back] < _HEAD_M)
    probabilities[HEAD] = torch.where(
        head_is_low, torch.maximum(probabilities[HEAD], probabilities[BACK]), probabilities[HEAD]
    )
    return probabilities


def _lowest_heights(state: State) -> Tensor:
    """Return the height (N, P) of the lowest skin of each part, metres."""
    height = torch.where(state.model.outer, state.vertices @ state.up, torch.inf)
    return _part_gaps(state.model, height)


def observed_touch(state: State, part: str, touched: str) -> Tensor:
    """Return the probability (N,) by the observer that a part touches one of
    :data:`physic_core.types.TOUCHED`; NaN where it says nothing.
    """
    row = OBSERVED.get(part)
    if row is None or state.observed_touch is None:
        return state.vertices.new_full((len(state),), torch.nan)
    return state.observed_touch[:, row, TOUCHED.index(touched)].to(state.vertices)


def values_by_vertex(model: BodyModel, value_of_part: Mapping[str, Tensor]) -> Tensor:
    """Return the value (N, V) of the part of each vertex; part -> (N,), in the order of all."""
    return torch.stack(list(value_of_part.values()), 1)[:, contact_regions(model).region]


def held_object_probability(state: State) -> Tensor:
    """Return the probability (N, V) that palms and fingers hold or pet an object or an animal; 0
    where the observer says nothing.
    """
    probability = torch.zeros_like(state.vertices[..., 0])
    for hand in (f"{side}_hand" for side in SIDES):
        hand_probability = observed_touch(state, hand, "object").nan_to_num()
        probability[:, state.model.contact_set_mask(hand)] = hand_probability[:, None]
    return probability


def hidden_parts(state: State) -> dict[str, Tensor]:
    """Return part -> (N,) bool: no photo has a confident keypoint at the end of the limb."""
    shown = state.visible_vertices
    return {
        name: ~shown[:, chosen].any(1) for name, chosen in contact_part_masks(state.model).items()
    }


class SceneProximity(NamedTuple):
    """Distances of N people's parts and vertices from the scene.

    Attributes:
        gap: (N, P) signed distance of each part of :func:`contact_part_masks`, metres; inf if
            nothing is near.
        down: (N, P) cosine between down and the skin of the part that is nearest to the surface, or
            lowest where nothing is near.
        rise: (N, V) how much farther the vertex is than its part, metres, at least 0; inf if it is
            far.
        facing: (N, V) cosine between the skin and the surface that it faces.
    """

    gap: Tensor
    down: Tensor
    rise: Tensor
    facing: Tensor


def scene_proximity(state: State, distances: Distances) -> SceneProximity:
    """Return where vertices are beside scene and floor.

    A part with nothing near it is compared with a level surface under its lowest vertices.
    """
    distance, facing = _scene_distance_and_facing(state, distances)
    height = state.vertices @ state.up
    group = contact_regions(state.model).region
    gap = _part_gaps(state.model, distance)
    far = torch.isinf(gap)[:, group]
    rise_over_lowest = torch.where(
        state.model.outer, height - _lowest_heights(state)[:, group], torch.inf
    )
    rise = torch.where(far, rise_over_lowest, distance - gap[:, group])
    down = -(distances.normals @ state.up)
    return SceneProximity(
        gap=gap,
        down=_mean_over_nearest_skin(state.model, rise, down),
        rise=torch.relu(rise),
        facing=torch.where(far, down, facing),
    )


def vertex_shares(model: BodyModel, near: SceneProximity) -> Tensor:
    """Return the share (N, V) of the probability of a part that its vertices have: 1 for the ten
    surest.
    """
    share = _raw_vertex_shares(model, near.rise, near.facing)
    for chosen in contact_part_masks(model).values():
        part_share = share[:, chosen]
        surest_least = part_share.topk(min(LARGEST_VERTICES, part_share.shape[1])).values[:, -1:]
        share[:, chosen] = (
            part_share / surest_least.clamp(min=torch.finfo(part_share.dtype).tiny)
        ).clamp(max=1)
    return share


def _raw_vertex_shares(model: BodyModel, rise: Tensor, facing: Tensor) -> Tensor:
    """Return the share (N, V) of the probability of a part that its vertices have.

    Args:
        model: of the bodies.
        rise: (N, V) how much farther the vertex is than its part, metres.
        facing: (N, V) cosine between the skin and the surface that it faces.
    """
    limbs = model.part_mask("hand", "foot")
    far_m, power = (
        torch.where(limbs, of_limbs, otherwise)
        for of_limbs, otherwise in zip(_NEARNESS_OF_LIMBS, _NEARNESS, strict=True)
    )
    return ((1 + facing) / 2) ** power / (1 + (rise / far_m).square())


def part_gap_sigmas(model: BodyModel, near: SceneProximity) -> dict[str, Tensor]:
    """Return part -> its distance (N,) from the scene, in standard deviations, at least 0."""
    gaps = torch.relu(near.gap).clamp(max=SEARCH_RADIUS_M) / _SIGMA_M
    return dict(zip(contact_part_masks(model), gaps.T, strict=True))


def is_lying(state: State) -> Tensor:
    """Return the people (N,) bool whose trunk is nearly horizontal."""
    tilt = torch.as_tensor(trunk_tilt_deg(*exact_arrays(state.joints, state.up)))
    return (tilt - 90).abs() < LYING_DEG


def _mean_over_nearest_skin(model: BodyModel, rise: Tensor, values: Tensor) -> Tensor:
    """Return the mean (N, P) of values (N, V) over the vertices of each part with the smallest
    rises (N, V) over its nearest skin.
    """
    means = []
    for chosen in contact_part_masks(model).values():
        nearest = rise[:, chosen].topk(LARGEST_VERTICES, largest=False).indices
        means.append(values[:, chosen].gather(1, nearest).mean(1))
    return torch.stack(means, 1)


def _part_gaps(model: BodyModel, distance: Tensor) -> Tensor:
    """Return the fifth smallest of the distances (N, V) of each part, (N, P)."""
    parts = contact_part_masks(model).values()
    return torch.stack([distance[:, chosen].kthvalue(_GAP_VERTICES).values for chosen in parts], 1)


def _scene_distance_and_facing(state: State, near: Distances) -> tuple[Tensor, Tensor]:
    """Return the distance (N, V) of outer vertices to scene or floor, and the cosine (N, V) with
    which they face it.

    The floor's plane is fitted to many points, so it gives the distance to the floor within reach.
    """
    surface = near.surface
    by_plane = surface.floor_is_nearer | (near.nearest_is_ground & torch.isfinite(surface.floor))
    distance = torch.where(by_plane, surface.floor, surface.scene)
    surface_normals = torch.where(by_plane[..., None], state.up, surface.normals)
    return torch.where(state.model.outer, distance, torch.inf), -(
        near.normals * surface_normals
    ).sum(-1)


def skin_contact_probability(near: Distances) -> Tensor:
    """Return the probability (2, N, V) that a vertex touches skin of another person, and of the own
    body.
    """
    probability = near.people_skin.distance.new_zeros(2, *near.people_skin.distance.shape)
    for contact in near.skin_contacts:
        kind = int(contact.other == contact.person)
        probability[kind, contact.person, contact.skin] = contact.probability
        probability[kind, contact.other, contact.other_skin] = contact.probability
    return probability
