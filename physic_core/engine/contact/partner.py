"""Partner of each contact vertex: floor, part of the scene, skin, an object, or what the scene has
no surface of: the picture names it, or it is hidden.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import torch
from torch import Tensor

from physic_core.engine.body_parts import SEAT, ContactRegions, are_adjacent, is_farther_out
from physic_core.engine.contact.distances import (
    HAND_BREADTH_M,
    KINDS,
    SEARCH_RADIUS_M,
    Distances,
)
from physic_core.engine.contact.parts import FACES_UP, SAT_ON, UPRIGHT_CLASSES
from physic_core.engine.contact.probability import mean_of_largest
from physic_core.engine.contact.surface_in_photo import PeopleInPhoto
from physic_core.types.contacts import NO_PARTNER, BodyContact, ContactPartner
from physic_core.types.observations import LEAST_PROBABILITY
from physic_core.types.people import GROUND_SURFACES
from physic_core.types.skeletons import SIDES

HIDDEN = len(KINDS)
HIDDEN_SEAT = len(KINDS) + 1
"""Further partners of a vertex, beside those of ``KINDS``: a hidden support, or a hidden seat."""

DECIMALS = 4
"""Decimals of probabilities and lengths of listed contacts and supports."""

MIN_VERTICES = 3
"""Least number of vertices of a contact that is listed."""

_OF_WORLD = ("floor", "scene", "hidden")
_SKIN = ("person", "self")
_DENT_QUANTILE = 0.9  # of the depths of a part's vertices in a dent
_GROUND_M = 0.05  # height over the floor of feet that stand on it: its error and that of the pose


@dataclass(frozen=True)
class TouchInPhoto:
    """What is seen of what N people touch.

    Attributes:
        carriers: name of each carrier, and vertices (N, V) bool of limbs that it carries.
        foot_floor_probability: (N, 2) that left and right foot are on the floor if they touch
            anything, NaN where unknown; None if unknown of all.
        picture: what it shows beside parts; None if unknown.
        has_floor: whether the scene has a plane of the floor.
    """

    carriers: Sequence[tuple[str, Tensor]] = ()
    foot_floor_probability: Tensor | None = None
    picture: PeopleInPhoto | None = None
    has_floor: bool = True

    @property
    def floor(self) -> ContactPartner:
        """The floor; one without a plane is a part of the scene that the picture shows."""
        return ContactPartner("floor" if self.has_floor else "scene", "floor")


def assign_partners(
    touched: Tensor, near: Distances, regions: ContactRegions, up: Tensor, photo_touch: TouchInPhoto
) -> tuple[tuple[ContactPartner, ...], Tensor]:
    """Name the partner of each contact vertex.

    Feet are on the floor, or on something else, if the observer says so; where it says nothing,
    those at its height are on it, whatever label is near. What else touches scene or a hidden
    support on a carrier touches the carrier. A surface has the most frequent class of its points. A
    class on which nothing rests, such as "wall", does not name what lies under a sole: the surface
    is then nameless there. What people sit on is a seat unless its class is another of those on
    which people sit. What the scene has no surface of has the name that the
    picture gives it, and is hidden only where the picture does not show it.

    Args:
        touched: (N, V) int64, what a vertex touches: index into ``KINDS``, :data:`HIDDEN` or
            :data:`HIDDEN_SEAT`; -1 without contact.
        near: distances to all of these.
        regions: body parts.
        up: (3,) unit.
        photo_touch: what the photo shows of it.

    Returns:
        All partners, and the index (N, V) int16 of each vertex's; :data:`NO_PARTNER` without
        contact.
    """
    index = torch.full(touched.shape, NO_PARTNER, dtype=torch.int16)
    numbers: dict[ContactPartner, int] = {}
    for rows, partner in _partner_candidates(touched, near, regions, up, photo_touch):
        rows = rows & (index == NO_PARTNER)
        if rows.any():
            index[rows] = numbers.setdefault(partner, len(numbers))
    return tuple(numbers), index


def _partner_candidates(
    touched: Tensor, near: Distances, regions: ContactRegions, up: Tensor, photo_touch: TouchInPhoto
) -> Iterator[tuple[Tensor, ContactPartner]]:
    """Yield the vertices (N, V) bool of each partner; there may be none, and the first counts: what
    is known of a limb before what its place says, and names before partners without one.
    """
    on_scene = touched == KINDS.index("scene")
    hidden = touched >= HIDDEN
    foot_on_floor, foot_elsewhere = _feet_on_floor(
        near, regions, photo_touch.foot_floor_probability
    )
    # Feet on the floor: before carriers, since a rider may put a foot down.
    yield (on_scene | hidden) & foot_on_floor, photo_touch.floor
    # Carriers: before the floor and surfaces, whose points near a limb may be the carrier's.
    for number, (name, carried) in enumerate(photo_touch.carriers):
        yield carried & on_scene, ContactPartner("scene", name, id=number)
        yield carried & hidden, ContactPartner("hidden", name, id=number)
    # The floor: before other surfaces, of which the ground is none.
    on_ground = near.surface.floor_is_nearer | near.nearest_is_ground
    yield on_scene & on_ground & ~foot_elsewhere, photo_touch.floor
    # Surfaces: of what is left of the scene, all but feet on ground that is not theirs.
    yield from _surface_partners(
        on_scene & ~on_ground, near, regions, up, len(photo_touch.carriers)
    )
    yield from _skin_partners(touched, near, regions)
    yield touched == KINDS.index("object"), ContactPartner("object")
    # The picture's names: before those without a name below.
    if photo_touch.picture is not None:
        unmeasured = hidden | (on_scene & foot_elsewhere)
        yield from _partners_in_photo(unmeasured, regions, foot_elsewhere, photo_touch)
    yield touched == HIDDEN_SEAT, ContactPartner("hidden", "seat")
    # The rest: hidden, and feet on the scene that are not on the floor.
    yield hidden, ContactPartner("hidden")
    yield on_scene, ContactPartner("scene")


def _skin_partners(
    touched: Tensor, near: Distances, regions: ContactRegions
) -> Iterator[tuple[Tensor, ContactPartner]]:
    """Yield the vertices (N, V) bool of each body part of people that skin touches."""
    for kind, skin in (("person", near.people_skin), ("own body", near.own_skin)):
        on_skin = touched == KINDS.index(kind)
        person = skin.person if kind == "person" else torch.zeros_like(skin.person)
        pair = person * len(regions.names) + regions.region[skin.vertex]
        for region_code in torch.unique(pair[on_skin]).tolist():
            other, part = divmod(region_code, len(regions.names))
            partner = (
                ContactPartner("person", person=other)
                if kind == "person"
                else ContactPartner("self")
            )
            yield on_skin & (pair == region_code), replace(partner, part=regions.names[part])


def _partners_in_photo(
    unmeasured: Tensor, regions: ContactRegions, foot_elsewhere: Tensor, photo_touch: TouchInPhoto
) -> Iterator[tuple[Tensor, ContactPartner]]:
    """Yield the vertices (N, V) bool of each partner that the picture shows.

    Args:
        unmeasured: (N, V) bool, skin that touches what the scene has no surface of.
        regions: body parts.
        foot_elsewhere: (N, V) bool, feet that are not on the floor.
        photo_touch: with the photo.
    """
    picture = photo_touch.picture
    assert picture is not None
    unmeasured = unmeasured & picture.on_visible_limb
    for number, part in enumerate(regions.names):
        part_vertices = unmeasured & (regions.region == number)
        for person in part_vertices.any(1).nonzero()[:, 0].tolist():
            name = picture.carrier_name_of_part(person, part, regions.region == number)
            rows = torch.zeros_like(part_vertices)
            rows[person] = part_vertices[person]
            if name in GROUND_SURFACES:
                yield rows & ~foot_elsewhere, photo_touch.floor
                name = ""
            if name is not None:
                yield rows, ContactPartner("scene", name)


def _surface_partners(
    on_scene: Tensor, near: Distances, regions: ContactRegions, up: Tensor, first_id: int
) -> Iterator[tuple[Tensor, ContactPartner]]:
    """Yield the vertices (N, V) bool of each surface but the floor, numbered from the first one."""
    surfaces = near.surface
    parts = near.parts
    if on_scene.any():
        surface = parts.surface[surfaces.point]
        rests = _rests_on_scene(near.normals @ up, on_scene, regions)
        sits = torch.zeros_like(rests)
        if SEAT in regions.names:
            sits |= regions.region == regions.names.index(SEAT)
        for number, surface_number in enumerate(torch.unique(surface[on_scene]).tolist(), first_id):
            rows = on_scene & (surface == surface_number)
            label = int(parts.label[surfaces.point[rows]].mode().values)
            name = parts.names[label] if label >= 0 else ""
            if name not in SAT_ON:
                yield rows & sits, ContactPartner("scene", "seat", id=number)
            if name in UPRIGHT_CLASSES:
                yield rows & rests, ContactPartner("scene", id=number)
            yield rows, ContactPartner("scene", name, id=number)


def _feet_on_floor(
    near: Distances, regions: ContactRegions, floor_probability: Tensor | None
) -> tuple[Tensor, Tensor]:
    """Return the vertices (N, V) bool of feet that are on the floor if they touch anything, and
    those of feet that are surely on something else.
    """
    height = near.surface.floor.abs()
    on_floor, elsewhere = torch.zeros(2, *height.shape, dtype=torch.bool)
    for side, name in enumerate(f"{side}_foot" for side in SIDES):
        if name not in regions.names:
            continue
        foot = regions.region == regions.names.index(name)
        near_floor = height[:, foot].amin(1) < _GROUND_M
        observed = torch.full_like(near_floor, torch.nan, dtype=height.dtype)
        if floor_probability is not None:
            observed = floor_probability[:, side].to(height)
        on_floor |= (
            foot & torch.where(observed.isnan(), near_floor, observed >= LEAST_PROBABILITY)[:, None]
        )
        elsewhere |= foot & (observed < LEAST_PROBABILITY)[:, None]
    return on_floor, elsewhere


def _rests_on_scene(facing: Tensor, on_scene: Tensor, regions: ContactRegions) -> Tensor:
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
    return (total < -FACES_UP * touching).gather(1, region)


def body_contacts(
    index: Tensor,
    probability: Tensor | None,
    dent: Tensor,
    partners: Sequence[ContactPartner],
    regions: ContactRegions,
    *,
    assumed: Mapping[str, float] = MappingProxyType({}),
    skin_contact_parts: Collection[str] = (),
    gaps: Mapping[str, float] = MappingProxyType({}),
    distance_from_people: Tensor | None = None,
    min_probability: float = 0.0,
) -> tuple[BodyContact, ...]:
    """List the contacts of one person by body part, most probable first.

    Contacts of fewer than three vertices are not listed, nor those of adjacent parts of one body,
    such as an arm and the torso. Two parts of one body that touch each other are listed once, for
    the more distal part.

    Args:
        index: (V,) of each vertex in ``partners``; :data:`NO_PARTNER` without contact.
        probability: (V,) of contact; None leaves all probabilities undefined. That of contact of a
            part is the mean of its ten most probable vertices.
        dent: (V,) depth of the dent at each vertex, metres; NaN where nothing yields.
        partners: all of them.
        regions: body parts.
        assumed: body parts of limbs that nothing shows -> their probability of contact with scene
            and floor. Of each, only the partner of most vertices is listed, and skin if it is met.
        skin_contact_parts: body parts that meet skin by the observer.
        gaps: body part -> its distance from the nearest surface, metres.
        distance_from_people: (V,) distance from the skin of other people, metres.
        min_probability: minimum probability of a listed part.
    """
    touching = index >= 0
    code = index.long() * len(regions.names) + regions.region
    contacts = []
    for part_code, count in zip(
        *(x.tolist() for x in torch.unique(code[touching], return_counts=True)), strict=True
    ):
        if count < MIN_VERTICES:
            continue
        partner, number = divmod(part_code, len(regions.names))
        part = regions.names[number]
        contact_vertices = touching & (code == part_code)
        rounded_probability = None
        kind = partners[partner].kind
        is_skin = kind in _SKIN
        if part in assumed and is_skin and part not in skin_contact_parts:
            continue
        if probability is not None:
            of_surest = mean_of_largest(probability[contact_vertices])
            of_part = assumed.get(part, of_surest) if kind in _OF_WORLD else of_surest
            rounded_probability = round(of_part, DECIMALS)
        if rounded_probability is None or rounded_probability >= min_probability:
            contact = BodyContact(
                part, partners[partner], rounded_probability, count, assumed=part in assumed
            )
            distance = None
            if kind == "person" and distance_from_people is not None:
                gap_to_people = float(distance_from_people[contact_vertices].amin())
                distance = (
                    round(gap_to_people, DECIMALS) if gap_to_people > HAND_BREADTH_M else None
                )
            elif kind in _OF_WORLD and part not in assumed:
                distance = _stated_distance(kind, gaps.get(part))
            contacts.append(
                replace(contact, dent_m=_dent_depth(dent[contact_vertices]), distance_m=distance)
            )
    return _listed_contacts(contacts)


def _stated_distance(kind: str, gap: float | None) -> float | None:
    """Return the distance of a part from the nearest surface, metres; None where that is near, and
    what it touches is not hidden.
    """
    if gap is None or not (kind == "hidden" or gap > HAND_BREADTH_M):
        return None
    return round(min(gap, SEARCH_RADIUS_M), DECIMALS)


def _listed_contacts(contacts: Sequence[BodyContact]) -> tuple[BodyContact, ...]:
    """Leave out contacts of adjacent parts, repeated pairs of parts, and all but the partner of
    most vertices of assumed parts; most probable first.
    """
    on_self = {
        (contact.part, contact.partner.part)
        for contact in contacts
        if contact.partner.kind == "self"
    }
    contacts = [
        contact
        for contact in contacts
        if contact.partner.kind != "self" or _is_listed(contact.part, contact.partner.part, on_self)
    ]
    main_contact = {
        contact.part: contact for contact in sorted(contacts, key=lambda one: one.vertices)
    }
    contacts = [
        contact
        for contact in contacts
        if not contact.assumed or contact is main_contact[contact.part]
    ]
    return tuple(sorted(contacts, key=lambda one: (-(one.probability or 0.0), -one.vertices)))


def _is_listed(part: str, other: str, pairs: Collection[tuple[str, str]]) -> bool:
    """Return whether the contact of a part with another of the same body is listed, among all such
    pairs.
    """
    if are_adjacent(part, other):
        return False
    return (other, part) not in pairs or is_farther_out(part, other)


def _dent_depth(depths: Tensor) -> float | None:
    """Return the depth of a dent with depths (n,) of its vertices; None if too few of them
    yield.
    """
    known = depths[torch.isfinite(depths)]
    return (
        round(float(known.quantile(_DENT_QUANTILE)), DECIMALS)
        if len(known) >= MIN_VERTICES
        else None
    )
