"""What carries a person: contacts that can carry, balance of the body over them, and hidden supports.

A person is balanced if the centre of mass is over the convex hull of the contacts that carry, or below hands that hold
something. If it is not, the point map may not have what carries the person: it has front surfaces only, people hide
what they sit on, and a bar is a few pixels wide. Hypotheses of a hidden support are compared then: under feet, seat,
knees, back, trunk, or at the hands. The cheapest one by balance, pose, contact prior and nearest surface is assumed.
Camera frame, metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, SIDES, joint_pair
from physic_core.body.model import BodyModel
from physic_core.engine.contact.partner import body_contacts
from physic_core.engine.contact.probability import CARRYING
from physic_core.engine.joint.distances import hinge_angles
from physic_core.engine.joint.limbs import is_sitting
from physic_core.types.contacts import NO_PARTNER, BodyContact, ContactPartner
from physic_core.types.support import Support, SupportState

__all__ = [
    "DOWNWARD",
    "Carried",
    "ContactEvidence",
    "PosedPerson",
    "beside_hull",
    "centre_of_mass",
    "find_support",
    "hands_may_hold",
    "support_record",
    "with_support",
]

_NECK, _PELVIS = JOINT_INDEX["neck"], JOINT_INDEX["pelvis"]
_SHOULDERS, _WRISTS = joint_pair("shoulder"), joint_pair("wrist")
_KNEES, _ANKLES = joint_pair("knee"), joint_pair("ankle")
DOWNWARD = -0.3
"""Cosine between a normal and up; skin below it faces down, and can rest on something."""

_BALANCE_M = 0.12  # metres beside the hull within which a body is balanced; poses are off by a decimetre along the ray
_PATCH_M = 0.04  # thickness of the layer of vertices that rests on a hidden support; cushions give way
_BED_M = 0.1  # the same of a lying body
_LOWEST_SHARE = 0.02
_MIN_VERTICES = 10  # of a body part that carries
_DIRECTIONS = 360  # of the supporting lines of a hull; distances are right to 1 % of its size
_MIN_HOLD_PROBABILITY = 0.75  # of the contact prior, mean of a hand that holds something
_LEVEL_TRUNK_COSINE = 0.5  # 60 degrees between up and the trunk of a person who lies
_KNEELING_FLEXION = 1.0  # radians

# Costs are negative log odds, set by hand.
_MOVING_COST = 0.6  # of a body without balance, in motion
_FEET_COST, _SEAT_COST, _HOLD_COST, _BED_COST, _BACK_COST, _KNEES_COST = 1.2, 0.9, 1.9, 1.2, 2.3, 2.3
_BALANCE_SIGMA_M = 0.1  # of the distance beyond the balance
_GAP_SIGMA_M, _MAX_GAP_M = 0.075, 0.15  # of the distance from a part to the nearest surface
_MAX_LOG_ODDS = 3.0  # of the contact prior


@dataclass(frozen=True)
class PosedPerson:
    """Posed body of one person.

    Attributes:
        vertices: (V, 3) metres.
        normals: (V, 3) unit, out of the body.
        joints: (55, 3) metres.
        rotations: (55, 3, 3).
    """

    vertices: Tensor
    normals: Tensor
    joints: Tensor
    rotations: Tensor


@dataclass(frozen=True)
class ContactEvidence:
    """What is known of the contact of one person.

    Attributes:
        contact: (V,) bool, with scene, floor and other people.
        may_touch: (V,) bool, vertices that can be in contact.
        distance: (V,) signed, to the nearest surface, metres; inf beyond the search radius.
        prior: (V,) probability of the contact prior.
        lifted_feet: (2,) bool, left and right foot in the air.
        seen: (V,) bool, vertices on limbs that the photo shows.
        hanging: whether the person was found to hang from the hands by the pose.
    """

    contact: Tensor
    may_touch: Tensor
    distance: Tensor
    prior: Tensor
    lifted_feet: Tensor
    seen: Tensor
    hanging: bool = False


@dataclass(frozen=True)
class Carried:
    """Support of one person.

    Attributes:
        state: how the person is carried.
        contact: (V,) bool, contacts that carry.
        hidden: (V,) bool, vertices on a hidden support.
        hidden_is_seat: whether that support is a seat.
        outside_m: distance of the centre of mass from the hull of both, negative inside; inf without contacts.
        centre: (3,) centre of mass, metres.
    """

    state: SupportState
    contact: Tensor
    hidden: Tensor
    hidden_is_seat: bool
    outside_m: float
    centre: Tensor


@dataclass(frozen=True)
class _Hypothesis:
    """Hidden support of one or more body parts.

    Attributes:
        patch: (V,) bool, vertices on it.
        rests: (V,) bool, vertices that may rest on something beside it.
        cost: before the evidence.
        is_seat: whether it is a seat.
        needs_surface: whether the scene should have a surface near it. People hide their seat, and a bar is too thin.
    """

    patch: Tensor
    rests: Tensor
    cost: float
    is_seat: bool = False
    needs_surface: bool = True


def find_support(
    model: BodyModel, body: PosedPerson, evidence: ContactEvidence, up: Tensor, *, assume: bool
) -> Carried:
    """Find what carries a person.

    Contacts whose skin faces down carry, and hands above the centre of mass. If they do not balance the body, all
    contacts carry, such as a back against a wall: an upright surface alone carries no weight. If they do not balance it
    either, the hands of who hangs hold something hidden. For other people the cheapest hypothesis is returned: the
    person moves, or a hidden support carries. A support that balances the body only with contacts of limbs that the
    photo does not show is assumed, too.

    Args:
        evidence: of the contacts.
        up: (3,) unit.
        assume: whether hidden supports are considered.
    """
    contact, vertices = evidence.contact, body.vertices
    centre = centre_of_mass(vertices, model.faces)
    none = torch.zeros_like(contact)
    hands = none.clone()
    for side in SIDES:
        hands[model.contact_sets[f"{side}_hand"]] = True
    hold = contact & hands & ((vertices - centre) @ up > 0)
    level = contact & (body.normals @ up < DOWNWARD) & ~hold
    on_part = torch.bincount(model.part_of_vertex[level], minlength=len(model.part_names))
    level &= (on_part >= _MIN_VERTICES)[model.part_of_vertex]
    hanging = SupportState.BALANCED if bool(level.any()) else SupportState.HANGING
    leaning = contact if bool((level | hold).any()) else none
    for state, carrying in (
        (SupportState.BALANCED, level),
        (hanging, level | hold),
        (SupportState.BALANCED, leaning),
    ):
        outside = beside_hull(centre, vertices[carrying], up)
        if outside <= _BALANCE_M:
            if beside_hull(centre, vertices[carrying & evidence.seen], up) > _BALANCE_M:
                state = SupportState.ASSUMED
            return Carried(state, carrying, none, False, outside, centre)
    airborne = bool(evidence.lifted_feet.all()) and not bool(contact.any())
    state = SupportState.AIRBORNE if airborne else SupportState.UNBALANCED
    moving = Carried(state, contact, none, False, outside, centre)
    if not assume:
        return moving
    best, least = moving, _MOVING_COST + (0.0 if airborne else _imbalance(outside))
    if evidence.hanging:
        least = float("inf")  # stage 3 has compared the hypotheses
    for hypothesis in _hypotheses(model, body, evidence, up):
        hidden = hypothesis.patch & ~contact
        outside = beside_hull(centre, vertices[contact | hidden | hypothesis.rests], up)
        cost = hypothesis.cost + _imbalance(outside) - _log_odds(evidence.prior[hypothesis.patch])
        if hypothesis.needs_surface:
            cost += _surface_gap(evidence.distance[hypothesis.patch])
        if cost < least:
            state = SupportState.ASSUMED if outside <= _BALANCE_M else SupportState.UNBALANCED
            best, least = Carried(state, contact, hidden, hypothesis.is_seat, outside, centre), cost
    return best


def support_record(
    carried: Carried,
    index: Tensor,
    probability: Tensor | None,
    table: Sequence[ContactPartner],
    region_names: Sequence[str],
    region: Tensor,
) -> Support:
    """Describe a support by body parts.

    Args:
        carried: of :func:`find_support`.
        index: (V,) partner of each vertex, index into ``table``; :data:`NO_PARTNER` without contact.
        probability: (V,) of contact, or None.
        table: partners.
        region_names: of the body parts.
        region: (V,) int64, body part of each vertex.
    """
    hidden = ContactPartner("hidden", "seat" if carried.hidden_is_seat else "")
    # Contacts of limbs that the photo does not show have no partner, and carry nevertheless.
    partners = (*table, hidden)
    carrying = torch.where(carried.contact & ~carried.hidden, index.long(), NO_PARTNER)
    carrying = torch.where(carried.hidden, len(table), carrying)
    parts = body_contacts(carrying, probability, partners, region_names, region)
    contacts = tuple(one for one in parts if one.vertices >= _MIN_VERTICES or one.partner.kind == "hidden")
    if carried.state in (SupportState.BALANCED, SupportState.ASSUMED) and not bool(carried.hidden.any()):
        contacts = tuple(map(_surer, contacts))
    x, y, z = carried.centre.tolist()
    outside = round(carried.outside_m, 4) if carried.outside_m < float("inf") else None
    return Support(carried.state, contacts, outside, (round(x, 4), round(y, 4), round(z, 4)))


def with_support(contacts: tuple[BodyContact, ...], support: Support) -> tuple[BodyContact, ...]:
    """Return a person's contacts by body part; those that carry the person have the probability of the support."""
    known = {(one.part, one.partner): one.probability for one in support.contacts}
    found = (replace(one, probability=known.get((one.part, one.partner), one.probability)) for one in contacts)
    return tuple(sorted(found, key=lambda one: (-(one.probability or 0.0), -one.vertices)))


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
    centre: Tensor = origin + moment / (4 * volume.sum())
    return centre


def beside_hull(centre: Tensor, points: Tensor, up: Tensor) -> float:
    """Return the horizontal distance of a point from the convex hull of points, metres; negative inside.

    Args:
        centre: (3,).
        points: (n, 3); inf is returned for n = 0.
        up: (3,) unit.
    """
    if not len(points):
        return float("inf")
    axis = torch.eye(3).to(up)[int(up.abs().argmin())]
    first = torch.nn.functional.normalize(torch.linalg.cross(up, axis), dim=0)
    second = torch.linalg.cross(up, first)
    angle = torch.arange(_DIRECTIONS).to(up) * (2 * torch.pi / _DIRECTIONS)
    directions = angle.cos()[:, None] * first + angle.sin()[:, None] * second
    return float(((centre - points) @ directions.T).amin(0).max())


def hands_may_hold(model: BodyModel, probability: Tensor) -> Tensor:
    """Return which hands may hold something, left and right, by the contact prior: (B, V) -> (B, 2) bool."""
    means = [probability[:, model.contact_sets[f"{side}_hand"]].mean(1) for side in SIDES]
    return torch.stack(means, 1) >= _MIN_HOLD_PROBABILITY


def _hypotheses(model: BodyModel, body: PosedPerson, evidence: ContactEvidence, up: Tensor) -> Iterator[_Hypothesis]:
    """Yield the hidden supports that the pose allows, with at least ten vertices each."""
    sets, none = model.contact_sets, torch.zeros_like(evidence.contact)

    def members(*names: str) -> Tensor:
        chosen = none.clone()
        for name in names:
            chosen[sets[name]] = True
        return chosen & evidence.may_touch

    def lowest(chosen: Tensor, thickness: float = _PATCH_M) -> Tensor:
        chosen = chosen & (body.normals @ up < DOWNWARD)
        if not bool(chosen.any()):
            return chosen
        height = body.vertices @ up
        bottom = height[chosen].kthvalue(max(1, round(_LOWEST_SHARE * int(chosen.sum())))).values
        return chosen & (height < bottom + thickness)

    soles = lowest(members("left_sole", "right_sole"))
    found = [_Hypothesis(soles, none, _FEET_COST)]
    in_air = bool(evidence.lifted_feet.all())
    if not in_air and bool(is_sitting(body.rotations[None], body.joints[None], up)[0]):
        seat = lowest(members("thighs", "gluteus"))
        found.append(_Hypothesis(seat, soles, _SEAT_COST, is_seat=True, needs_surface=False))
    held = hands_may_hold(model, evidence.prior[None])[0]
    if not bool(evidence.seen[torch.cat([sets["left_sole"], sets["right_sole"]])].any()):
        # Feet that the photo does not show stand on something more often than not.
        held &= (body.joints[_WRISTS] - body.joints[_SHOULDERS]) @ up > 0
    held |= evidence.hanging
    hands = members(*(f"{side}_hand" for side, holds in zip(SIDES, held, strict=True) if holds))
    hold = _Hypothesis(hands, none, _HOLD_COST, needs_surface=False)
    if evidence.hanging:
        return iter((hold,))
    found.append(hold)
    if bool(evidence.contact.any()):
        # A back leans on something, and does not carry a body alone.
        found.append(_Hypothesis(_outermost(body, members("back")), none, _BACK_COST))
    if bool((hinge_angles(body.rotations[None])[0, :2] > _KNEELING_FLEXION).any()):
        found.append(_Hypothesis(lowest(_knees(model, body) & evidence.may_touch), none, _KNEES_COST))
    trunk = torch.nn.functional.normalize(body.joints[_NECK] - body.joints[_PELVIS], dim=0)
    if abs(float(trunk @ up)) < _LEVEL_TRUNK_COSINE:
        found.append(_Hypothesis(lowest(model.outer & evidence.may_touch, _BED_M), none, _BED_COST))
    return (one for one in found if int(one.patch.sum()) >= _MIN_VERTICES)


def _surer(contact: BodyContact) -> BodyContact:
    """Return a contact that balances a person, with the probability that such contacts have."""
    if contact.probability is None or contact.part.endswith("hand"):
        return contact
    return replace(contact, probability=max(contact.probability, CARRYING))


def _knees(model: BodyModel, body: PosedPerson) -> Tensor:
    """Return the vertices (V,) bool of the lower legs that are nearer to the knee than to the ankle."""
    chosen = torch.zeros_like(model.outer)
    for side, knee, ankle in zip(SIDES, _KNEES, _ANKLES, strict=True):
        part = model.part_of_vertex == model.part_names.index(f"{side}_lower_leg")
        near, far = ((body.vertices - body.joints[j]).norm(dim=1) for j in (knee, ankle))
        chosen |= part & (near < far)
    return chosen


def _outermost(body: PosedPerson, chosen: Tensor) -> Tensor:
    """Return the vertices of a set that a plane on it touches, within 4 cm."""
    if not bool(chosen.any()):
        return chosen
    along = body.vertices @ torch.nn.functional.normalize(body.normals[chosen].mean(0), dim=0)
    return chosen & (along > float(along[chosen].max()) - _PATCH_M)


def _imbalance(outside: float) -> float:
    return 0.5 * (max(0.0, outside - _BALANCE_M) / _BALANCE_SIGMA_M) ** 2


def _surface_gap(distance: Tensor) -> float:
    return 0.5 * (min(float(distance.abs().min()), _MAX_GAP_M) / _GAP_SIGMA_M) ** 2


def _log_odds(probability: Tensor) -> float:
    return float(torch.logit(probability.mean().double(), 1e-6).clamp(-_MAX_LOG_ODDS, _MAX_LOG_ODDS))
