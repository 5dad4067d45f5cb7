"""Support of a person: contacts that can carry weight, balance of the body over them, and hidden
supports.

A seated person has a seat: the surface under buttocks and thighs, whatever else balances the body,
or a hidden one, which is under the back as well if the person lies. A person is balanced if the
centre of mass is over the convex hull of the carrying contacts, or below hands that hold something.
Feet alone balance a person only on heels that rest on enough ground: on less, the person is
unsteady. Otherwise, the photo may not show the support. A hidden support is assumed only where the
photo cannot show one, and if the body is balanced on it: something under feet that the photo does
not show, and a bar in the hands of people whose feet are in the air. Feet that the photo shows
stand on what it shows, or on nothing. Camera frame, metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel
from physic_core.engine.contact.partner import DECIMALS
from physic_core.engine.contact.parts import FACES_UP
from physic_core.types.contacts import BodyContact, Support, SupportState
from physic_core.types.skeletons import SIDES

# Distance from the hull within which a body is balanced: poses are off by a decimetre along the
# ray.
_BALANCE_M = 0.12
_PATCH_M = 0.04  # layer of vertices that rests on a hidden support; cushions give way
_LOWEST_SHARE = 0.02  # share of the vertices that counts as the lowest skin
_MIN_VERTICES = 10  # of a body part that carries
# Height over the ground from which a heel does not rest on it: poses are off by centimetres.
_HEEL_REACH_M = 0.1
_HEEL_FLATTENS_M = 0.02  # height over its lowest skin up to which a heel rests on the ground
_STEADY_M = 0.08  # least width of ground under heels that balances a body; on less, it falls
_DIRECTIONS = 360  # of the supporting lines of a hull; distances are right to 1 % of its size


@dataclass(frozen=True)
class PersonContact:
    """Posed body of one person, and the evidence of its contact.

    Attributes:
        vertices: (V, 3) metres.
        normals: (V, 3) unit, out of the body.
        contact: (V,) bool, with scene, floor and other people.
        on_visible_limb: (V,) bool, vertices on limbs that the photo shows.
        feet: (2,) bool, left and right foot that probably touch something; None if unknown.
        sits: whether buttocks probably rest on something.
        lies: whether the trunk is nearly horizontal.
        grips: (2,) bool, left and right hand that probably touch the scene; None if unknown.
        height: (V,) height of contacts over what they touch, metres, negative inside; inf of other
            skin.
    """

    vertices: Tensor
    normals: Tensor
    contact: Tensor
    on_visible_limb: Tensor
    feet: Tensor | None
    sits: bool
    lies: bool
    grips: Tensor | None
    height: Tensor

    @property
    def in_air(self) -> bool:
        """Whether neither foot touches anything."""
        return self.feet is not None and not self.feet.any()


@dataclass(frozen=True)
class PersonSupport:
    """Support of one person.

    Attributes:
        state: how the person is carried.
        contact: (V,) bool, contacts that carry.
        hidden: (V,) bool, vertices on a hidden support.
        seat: (V,) bool, vertices on a seat, found or hidden; none without a person who sits.
        outside_m: distance of the centre of mass from the hull of both, negative inside; inf
            without contacts.
        centre: (3,) centre of mass, metres.
    """

    state: SupportState
    contact: Tensor
    hidden: Tensor
    seat: Tensor
    outside_m: float
    centre: Tensor


def find_support(
    model: BodyModel, person: PersonContact, up: Tensor, *, assume: bool
) -> PersonSupport:
    """Find the support of a person.

    Heels over the ground do not carry. Contacts whose skin faces down do, as do hands above the
    centre of mass. If they do not balance the body, all contacts carry. So a back against a wall
    carries only beside other contacts: an upright surface carries no weight by itself. If they do
    not balance it either, the hidden support that balances the body best is assumed. A support
    that balances the body only with contacts of limbs that the photo does not show also counts as
    assumed.

    Args:
        model: body model.
        person: body and contacts.
        up: (3,) unit.
        assume: whether hidden supports are considered.
    """
    person = replace(person, contact=person.contact & ~_raised_heels(model, person))
    contact = person.contact
    vertices = person.vertices
    centre = centre_of_mass(vertices, model.faces)
    seat = none = torch.zeros_like(contact)
    outside = float("inf")
    level = _level_contacts(model, person, up)
    if person.sits:
        seat = level & _outer_vertices(model, "thighs", "gluteus")
        rests = _outer_vertices(model, *(("gluteus", "back") if person.lies else ("gluteus",)))
        patch = _lowest_layer(person, rests, up)
        if assume and not seat.any() and int(patch.sum()) >= _MIN_VERTICES:
            return _hidden_support(person, patch, none if person.lies else patch, centre, up)
    hold = _overhead_hands(model, person, centre, up)
    for state, carrying in _support_candidates(contact, level & ~hold, hold):
        outside = distance_to_hull(centre, vertices[carrying], up)
        if outside <= _BALANCE_M:
            if _is_unsteady(model, vertices, carrying, up):
                state = SupportState.UNSTEADY
            if (
                distance_to_hull(centre, vertices[carrying & person.on_visible_limb], up)
                > _BALANCE_M
            ):
                state = SupportState.ASSUMED
            return PersonSupport(state, carrying, none, seat, outside, centre)
    airborne = person.in_air and not contact.any()
    state = SupportState.AIRBORNE if airborne else SupportState.UNBALANCED
    best = PersonSupport(state, contact, none, seat, outside, centre)
    least = _BALANCE_M
    for patch in _hidden_supports(model, person, up) if assume else ():
        assumed = _hidden_support(person, patch, seat, centre, up)
        if assumed.outside_m <= least and int(patch.sum()) >= _MIN_VERTICES:
            best, least = assumed, assumed.outside_m
    return best


def _hidden_support(
    person: PersonContact, patch: Tensor, seat: Tensor, centre: Tensor, up: Tensor
) -> PersonSupport:
    """Return the support of a person whose contacts carry together with a hidden support of a patch
    (V,) of skin.
    """
    contact = person.contact
    outside = distance_to_hull(centre, person.vertices[contact | patch], up)
    return PersonSupport(SupportState.ASSUMED, contact, patch & ~contact, seat, outside, centre)


def _heel_masks(model: BodyModel) -> Iterator[Tensor]:
    """Yield the skin (V,) bool of heel and instep of each foot: without toes, which are too weak to
    balance a body.
    """
    joint = model.skin.weights.argmax(0)
    for side in SIDES:
        yield _outer_vertices(model, f"{side}_foot") & (joint == JOINT_INDEX[f"{side}_ankle"])


def _raised_heels(model: BodyModel, person: PersonContact) -> Tensor:
    """Return the skin (V,) bool of heels that the pose has too high over the ground to rest on
    it.
    """
    raised = torch.zeros_like(person.contact)
    for heel in _heel_masks(model):
        if float(person.height[heel].amin()) >= _HEEL_REACH_M:
            raised |= heel
    return raised


def _is_unsteady(model: BodyModel, vertices: Tensor, carrying: Tensor, up: Tensor) -> bool:
    """Return whether feet alone carry a person, and their heels rest on too little ground to stay
    up.
    """
    others = carrying & ~model.part_mask("_foot")
    if int(others.sum()) >= _MIN_VERTICES:
        return False
    height = vertices @ up
    rests = torch.zeros_like(carrying)
    for heel in _heel_masks(model):
        touching = heel & carrying
        if int(touching.sum()) >= _MIN_VERTICES:
            rests |= touching & (height < height[touching].amin() + _HEEL_FLATTENS_M)
    across = vertices[rests] @ _horizontal_directions(up).T
    return not len(across) or float((across.amax(0) - across.amin(0)).amin()) < _STEADY_M


def _level_contacts(model: BodyModel, person: PersonContact, up: Tensor) -> Tensor:
    """Return the contacts (V,) bool whose skin faces down, on body parts with enough of them to
    carry.
    """
    level = person.contact & (person.normals @ up < -FACES_UP)
    on_part = torch.bincount(model.part_of_vertex[level], minlength=len(model.part_names))
    return level & (on_part >= _MIN_VERTICES)[model.part_of_vertex]


def _overhead_hands(model: BodyModel, person: PersonContact, centre: Tensor, up: Tensor) -> Tensor:
    """Return the contacts (V,) bool of hands above the centre of mass."""
    hands = _outer_vertices(model, *(f"{side}_hand" for side in SIDES))
    return person.contact & hands & ((person.vertices - centre) @ up > 0)


def _support_candidates(
    contact: Tensor, level: Tensor, hold: Tensor
) -> Iterator[tuple[SupportState, Tensor]]:
    """Yield the contacts (V,) bool that may carry the person, the most certain first, with the
    state.
    """
    rests = bool(level.any())
    yield SupportState.BALANCED, level
    yield SupportState.BALANCED if rests else SupportState.HANGING, level | hold
    if rests or hold.any():
        yield SupportState.BALANCED, contact


def _hidden_supports(model: BodyModel, person: PersonContact, up: Tensor) -> Iterator[Tensor]:
    """Yield the vertices (V,) bool on each support that the photo cannot show."""
    stands = [True, True] if person.feet is None else person.feet.tolist()
    soles = [_outer_vertices(model, f"{side}_sole") for side in SIDES]
    if not person.in_air and not (person.on_visible_limb & (soles[0] | soles[1])).any():
        stood = torch.stack([sole & on for sole, on in zip(soles, stands, strict=True)]).any(0)
        yield _lowest_layer(person, stood, up)
    if person.in_air and person.grips is not None and person.grips.any():
        hands = (f"{side}_hand" for side, grips in zip(SIDES, person.grips, strict=True) if grips)
        yield _outer_vertices(model, *hands)


def support_record(
    carried: PersonSupport, contacts: Sequence[BodyContact], listed: Sequence[BodyContact]
) -> Support:
    """Describe a support by body parts; contacts that are only possible, or with a surface that is
    not listed, are omitted beside likely ones.

    Args:
        carried: of :func:`find_support`.
        contacts: of the vertices that carry.
        listed: all contacts of the person, whose probabilities are those of the support.
    """
    listed_probability = {
        (contact.part, contact.partner): contact.probability for contact in listed
    }
    large_contacts = (
        contact
        for contact in contacts
        if contact.vertices >= _MIN_VERTICES or not contact.partner.in_scene
    )
    listed_contacts = [
        replace(
            contact,
            probability=listed_probability.get((contact.part, contact.partner)),
            dent_m=None,
        )
        for contact in large_contacts
    ]
    likely_contacts = [
        contact
        for contact in listed_contacts
        if contact.likely
        and (
            (contact.part, contact.partner) in listed_probability
            or contact.partner.kind == "hidden"
        )
    ]
    listed_contacts = likely_contacts or listed_contacts
    listed_contacts.sort(key=lambda one: -(one.probability or 0.0))
    x, y, z = (round(value, DECIMALS) for value in carried.centre.tolist())
    outside = round(carried.outside_m, DECIMALS) if carried.outside_m < float("inf") else None
    return Support(carried.state, tuple(listed_contacts), outside, (x, y, z))


def centre_of_mass(vertices: Tensor, faces: Tensor) -> Tensor:
    """Return the centre of mass (3,) of a closed mesh of uniform density, metres.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) int64, counter-clockwise.
    """
    origin = vertices.mean(0)
    a, b, c = (vertices - origin)[faces].unbind(1)
    volume: Tensor = (a * torch.linalg.cross(b, c)).sum(-1)
    moment = (volume[:, None] * (a + b + c)).sum(0)
    return origin + moment / (4 * volume.sum())


def distance_to_hull(centre: Tensor, points: Tensor, up: Tensor) -> float:
    """Return the horizontal distance of a point from the convex hull of points, metres; negative
    inside.

    Args:
        centre: (3,).
        points: (n, 3); inf is returned for n = 0.
        up: (3,) unit.
    """
    if not len(points):
        return float("inf")
    return float(((centre - points) @ _horizontal_directions(up).T).amin(0).max())


def _horizontal_directions(up: Tensor) -> Tensor:
    """Return horizontal unit vectors (_DIRECTIONS, 3) all around."""
    axis = torch.eye(3).to(up)[int(up.abs().argmin())]
    first = torch.nn.functional.normalize(torch.linalg.cross(up, axis), dim=0)
    second = torch.linalg.cross(up, first)
    angle = torch.arange(_DIRECTIONS).to(up) * (2 * torch.pi / _DIRECTIONS)
    around: Tensor = angle.cos()[:, None] * first + angle.sin()[:, None] * second
    return around


def _outer_vertices(model: BodyModel, *names: str) -> Tensor:
    """Return the outer vertices (V,) bool of contact sets."""
    return model.contact_set_mask(*names) & model.outer


def _lowest_layer(person: PersonContact, chosen: Tensor, up: Tensor) -> Tensor:
    """Return the lowest layer of the chosen vertices (V,) bool that face down."""
    chosen = chosen & (person.normals @ up < -FACES_UP)
    if not chosen.any():
        return chosen
    height = person.vertices @ up
    bottom = height[chosen].kthvalue(max(1, round(_LOWEST_SHARE * int(chosen.sum())))).values
    return chosen & (height < bottom + _PATCH_M)
