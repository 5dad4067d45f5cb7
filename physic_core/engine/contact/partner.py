"""Partner of each contact vertex: floor, part of the scene, skin, or a hidden support."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import torch
from torch import Tensor

from physic_core.engine.contact.distances import KINDS, SEARCH_RADIUS_M, Distances
from physic_core.engine.contact.parts import (
    UPRIGHT_CLASSES,
    ContactRegions,
    are_adjacent,
    is_farther_out,
)
from physic_core.engine.contact.probability import mean_of_surest
from physic_core.types.contacts import NO_PARTNER, BodyContact, ContactPartner

HIDDEN = len(KINDS)
HIDDEN_SEAT = len(KINDS) + 1
"""Further partners of a vertex, beside those of ``KINDS``: a hidden support, or a hidden seat."""

DECIMALS = 4
"""Decimals of probabilities and lengths of listed contacts and supports."""

_MIN_VERTICES = 3  # of a contact that is listed
_DENT_QUANTILE = 0.9  # of the depths of a part's vertices in a dent
_GROUND_M = 0.05  # height over the floor of feet that stand on it: its error and that of the pose
_RESTS = -0.3  # cosine between up and the mean normal of touching skin; below it, the part rests


def assign_partners(
    touched: Tensor,
    near: Distances,
    regions: ContactRegions,
    up: Tensor,
    on_carriers: Sequence[tuple[str, Tensor]] = (),
) -> tuple[tuple[ContactPartner, ...], Tensor]:
    """Name the partner of each contact vertex.

    Feet at the height of the floor stand on it, whatever label is near. What else touches scene or
    a hidden support on a carrier touches the carrier. A surface has the most frequent class of its
    points. A class on which nothing rests, such as "wall", does not
    name what lies under a sole or a seat: the surface is then nameless there.

    Args:
        touched: (N, V) int64, what a vertex touches: index into ``KINDS``, :data:`HIDDEN` or
            :data:`HIDDEN_SEAT`; -1 without contact.
        near: distances to all of these.
        regions: body parts.
        up: (3,) unit.
        on_carriers: name of each carrier, and vertices (N, V) bool of limbs that it carries.

    Returns:
        All partners, and the index (N, V) int16 of each vertex's; :data:`NO_PARTNER` without
        contact.
    """
    index = torch.full(touched.shape, NO_PARTNER, dtype=torch.int16, device=touched.device)
    table: list[ContactPartner] = []
    for rows, partner in _partners(touched, near, regions, up, on_carriers):
        if bool(rows.any()):
            index[rows] = len(table)
            table.append(partner)
    return tuple(table), index


def _partners(
    touched: Tensor,
    near: Distances,
    regions: ContactRegions,
    up: Tensor,
    on_carriers: Sequence[tuple[str, Tensor]],
) -> Iterator[tuple[Tensor, ContactPartner]]:
    """Yield the vertices (N, V) bool of each partner; there may be none."""
    on_scene = touched == KINDS.index("scene")
    stands = _standing_feet(near, regions)
    for number, (name, carried) in enumerate(on_carriers):
        carried = carried & ~(on_scene & stands)
        yield carried & on_scene, ContactPartner("scene", name, id=number)
        hidden = carried & ((touched == HIDDEN) | (touched == HIDDEN_SEAT))
        yield hidden, ContactPartner("hidden", name, id=number)
        on_scene = on_scene & ~carried
        touched = torch.where(hidden, -1, touched)
    ground = near.surface.on_floor | near.on_ground | stands
    yield on_scene & ground, ContactPartner("floor", "floor")
    yield from _surfaces(on_scene & ~ground, near, regions, up, len(on_carriers))
    for kind, skin in (("person", near.people), ("own body", near.own)):
        on_skin = touched == KINDS.index(kind)
        person = skin.person if kind == "person" else torch.zeros_like(skin.person)
        pair = person * len(regions.names) + regions.region[skin.vertex]
        for code in torch.unique(pair[on_skin]).tolist():
            other, part = divmod(code, len(regions.names))
            whose = (
                ContactPartner("person", person=other)
                if kind == "person"
                else ContactPartner("self")
            )
            yield on_skin & (pair == code), replace(whose, part=regions.names[part])
    yield touched == KINDS.index("object"), ContactPartner("object")
    yield touched == HIDDEN_SEAT, ContactPartner("hidden", "seat")
    yield touched == HIDDEN, ContactPartner("hidden")


def _surfaces(
    on_scene: Tensor, near: Distances, regions: ContactRegions, up: Tensor, first: int
) -> Iterator[tuple[Tensor, ContactPartner]]:
    """Yield the vertices (N, V) bool of each surface but the floor, numbered from the first one."""
    surfaces = near.surface
    parts = near.parts
    if bool(on_scene.any()):
        surface = parts.surface[surfaces.point]
        rests = _resting(near.normals @ up, on_scene, regions)
        for number, own in enumerate(torch.unique(surface[on_scene]).tolist(), first):
            rows = on_scene & (surface == own)
            label = int(parts.label[surfaces.point[rows]].mode().values)
            name = parts.names[label] if label >= 0 else ""
            nameless = rests if name in UPRIGHT_CLASSES else torch.zeros_like(rests)
            yield rows & ~nameless, ContactPartner("scene", name, id=number)
            yield rows & nameless, ContactPartner("scene", id=number)


def _standing_feet(near: Distances, regions: ContactRegions) -> Tensor:
    """Return the vertices (N, V) bool of feet whose soles are at the height of the floor."""
    height = near.surface.floor.abs()
    found = torch.zeros_like(height, dtype=torch.bool)
    for number, name in enumerate(regions.names):
        if name.endswith("_foot"):
            foot = regions.region == number
            found |= foot & (height[:, foot].amin(1, keepdim=True) < _GROUND_M)
    return found


def _resting(facing: Tensor, on_scene: Tensor, regions: ContactRegions) -> Tensor:
    """Return the vertices (N, V) bool of body parts that rest on the scene.

    Args:
        facing: (N, V) cosine between normal and up.
        on_scene: (N, V) bool, contacts with the scene.
        regions: body parts.
    """
    count = len(regions.names)
    region = regions.region.expand_as(facing)
    total, touching = (
        torch.zeros(len(facing), count).to(facing).scatter_add(1, region, values)
        for values in (torch.where(on_scene, facing, 0.0), on_scene.to(facing))
    )
    return (total < _RESTS * touching).gather(1, region)


def body_contacts(
    index: Tensor,
    probability: Tensor | None,
    dent: Tensor,
    table: Sequence[ContactPartner],
    regions: ContactRegions,
    *,
    assumed: Mapping[str, float] = MappingProxyType({}),
    gaps: Mapping[str, float] = MappingProxyType({}),
    least: float = 0.0,
) -> tuple[BodyContact, ...]:
    """List the contacts of one person by body part, most probable first.

    Contacts of fewer than three vertices are not listed, nor those of adjacent parts of one body,
    such as an arm and the torso. Two parts of one body that touch each other are listed once, for
    the more distal part.

    Args:
        index: (V,) of each vertex in ``table``; :data:`NO_PARTNER` without contact.
        probability: (V,) of contact; None leaves all probabilities undefined. That of contact of a
            part is the mean of its ten most probable vertices.
        dent: (V,) depth of the dent at each vertex, metres; NaN where nothing yields.
        table: partners.
        regions: body parts.
        assumed: body parts of limbs that nothing shows -> their probability of contact with scene
            and floor. Of each, only the partner of most vertices is listed, and no skin.
        gaps: body part -> its distance from the nearest surface, metres.
        least: minimum probability of a listed part.
    """
    touching = index >= 0
    code = index.long() * len(regions.names) + regions.region
    found = []
    for value, count in zip(
        *(x.tolist() for x in torch.unique(code[touching], return_counts=True)), strict=True
    ):
        if count < _MIN_VERTICES:
            continue
        partner, number = divmod(value, len(regions.names))
        part = regions.names[number]
        here = touching & (code == value)
        sure = None
        kind = table[partner].kind
        if kind in ("person", "self", "object") and part in assumed:
            continue
        if probability is not None:
            likely = probability[here]
            sure = round(assumed.get(part, mean_of_surest(likely)), DECIMALS)
        gap = gaps.get(part) if kind == "hidden" and part not in assumed else None
        if sure is None or sure >= least:
            one = BodyContact(part, table[partner], sure, count, assumed=part in assumed)
            off = None if gap is None else round(min(gap, SEARCH_RADIUS_M), DECIMALS)
            found.append(replace(one, dent_m=_dent_of(dent[here]), distance_m=off))
    return _listed(found)


def _listed(found: Sequence[BodyContact]) -> tuple[BodyContact, ...]:
    """Leave out contacts of adjacent parts, repeated pairs of parts, and all but the partner of
    most vertices of assumed parts; most probable first.
    """
    on_self = {(one.part, one.partner.part) for one in found if one.partner.kind == "self"}
    found = [
        one
        for one in found
        if one.partner.kind != "self" or _is_listed(one.part, one.partner.part, on_self)
    ]
    most = {one.part: one for one in sorted(found, key=lambda one: one.vertices)}
    found = [one for one in found if not one.assumed or one is most[one.part]]
    return tuple(sorted(found, key=lambda one: (-(one.probability or 0.0), -one.vertices)))


def _is_listed(part: str, other: str, pairs: Collection[tuple[str, str]]) -> bool:
    """Return whether the contact of a part with another of the same body is listed, among all such
    pairs.
    """
    if are_adjacent(part, other):
        return False
    return (other, part) not in pairs or is_farther_out(part, other)


def _dent_of(depths: Tensor) -> float | None:
    """Return the depth of a dent with depths (n,) of its vertices; None if too few of them
    yield.
    """
    known = depths[torch.isfinite(depths)]
    return (
        round(float(known.quantile(_DENT_QUANTILE)), DECIMALS)
        if len(known) >= _MIN_VERTICES
        else None
    )
