"""Stage 4: which vertices touch, what they touch, and what supports each person (paper sec.

3.3).
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.contact.dents import dent_depths, largest_dents
from physic_core.engine.contact.features import KINDS, Distances, measure_distances
from physic_core.engine.contact.method import ContactMethod, Touch
from physic_core.engine.contact.partner import (
    HIDDEN,
    HIDDEN_SEAT,
    VertexContacts,
    assign_partners,
    body_contacts,
)
from physic_core.engine.contact.parts import SEAT, contact_parts, part_of_region, unseen_parts
from physic_core.engine.contact.probability import contact_model
from physic_core.engine.contact.problem import ContactInput, ContactResult
from physic_core.engine.contact.regions import contact_regions
from physic_core.engine.contact.support import (
    ContactEvidence,
    PersonSupport,
    PosedPerson,
    find_support,
    support_record,
)
from physic_core.engine.touch import LEAST_PROBABILITY
from physic_core.types.skeletons import SIDES

_PERSON, _OWN_BODY, _OBJECT = (KINDS.index(kind) for kind in ("person", "own body", "object"))
# cosine between up and the skin of another person; above it, a person can sit or stand there
_BEARS = 0.3


def solve_contact(given: ContactInput, method: ContactMethod) -> ContactResult:
    """Return the contact of all people. People with non-finite vertices touch nothing."""
    near = measure_distances(given, method.measure, skin=method.people)
    touch = method.touch(given, near)
    carried = _find_supports(given, near, touch, method)
    return _describe_contacts(given, near, _with_hidden(given, touch, carried), carried, method)


def _find_supports(
    given: ContactInput, near: Distances, touch: Touch, method: ContactMethod
) -> tuple[PersonSupport | None, ...]:
    """Return the support of each person; None for people with non-finite vertices."""
    beneath = near.normals[near.people.person, near.people.vertex] @ given.up
    # a lap carries, a neighbour's thigh does not
    beside = (touch.kind == _PERSON) & (beneath < _BEARS)
    outward = (touch.kind >= 0) & (touch.kind != _OWN_BODY) & (touch.kind != _OBJECT) & ~beside
    seen = given.seen
    found: list[PersonSupport | None] = []
    for i, finite in enumerate(given.finite.tolist()):
        if not finite:
            found.append(None)
            continue
        body = PosedPerson(given.vertices[i], near.normals[i])
        evidence = ContactEvidence(
            contact=outward[i],
            seen=seen[i],
            feet=_both(touch, "foot", i),
            sits=bool(touch.parts) and float(touch.parts[SEAT][i]) >= LEAST_PROBABILITY,
            holds=_both(touch, "hand", i),
        )
        found.append(
            find_support(given.model, body, evidence, given.up, assume=method.assume_supports)
        )
    return tuple(found)


def _both(touch: Touch, limb: str, person: int) -> Tensor | None:
    """Return whether the left and the right limb of a person probably touch the scene, (2,) bool;
    None if unknown.
    """
    if not touch.parts:
        return None
    return (
        torch.stack([touch.parts[f"{side}_{limb}"][person] for side in SIDES]) >= LEAST_PROBABILITY
    )


def _with_hidden(
    given: ContactInput, touch: Touch, carried: tuple[PersonSupport | None, ...]
) -> Touch:
    """Return the contacts with those of hidden supports.

    The probability of a seat, found or hidden, is that of sitting; other hidden supports are more
    likely than not.
    """
    kind = touch.kind.clone()
    probability = None if touch.probability is None else touch.probability.clone()
    likely = {name: values.clone() for name, values in touch.parts.items()}
    vertices = contact_parts(given.model) if likely else {}
    for i, one in enumerate(carried):
        if one is None:
            continue
        kind[i, one.hidden] = torch.where(one.seat[one.hidden], HIDDEN_SEAT, HIDDEN)
        if probability is not None:
            least = LEAST_PROBABILITY * one.hidden.to(probability)
            if touch.parts:
                least[one.seat] = touch.parts[SEAT][i]
            probability[i] = probability[i].maximum(least)
            for name, chosen in vertices.items():
                likely[name][i] = likely[name][i].clamp(min=float(least[chosen].max()))
    return replace(touch, kind=kind, probability=probability, parts=likely)


def _describe_contacts(
    given: ContactInput,
    near: Distances,
    touch: Touch,
    carried: tuple[PersonSupport | None, ...],
    method: ContactMethod,
) -> ContactResult:
    """Name partners and supports, and list the contacts of each body part."""
    regions = contact_regions(given.model)
    partners, index = assign_partners(touch.kind, near, regions, given.up)
    dents = dent_depths(near.surface.scene, largest_dents(near.surface, near.parts))
    dents = torch.where(touch.kind == KINDS.index("scene"), dents, torch.nan)
    unseen = unseen_parts(given) if touch.parts else {}
    contacts = []
    supports = []
    for i, one in enumerate(carried):
        carrying = torch.zeros_like(given.model.outer) if one is None else one.contact | one.hidden
        likely = None if touch.probability is None else touch.probability[i]
        person = VertexContacts(index[i], likely, dents[i])
        parts = {name: part_of_region(name) for name in regions.names if unseen}
        assumed = {
            name: float(touch.parts[part][i]) for name, part in parts.items() if unseen[part][i]
        }
        listed = body_contacts(
            person, partners, regions, contact_model(), assumed=assumed, least=LEAST_PROBABILITY
        )
        contacts.append(listed)
        own = VertexContacts(torch.where(carrying, index[i], -1), None, dents[i])
        bearing = body_contacts(own, partners, regions, assumed=assumed)
        supports.append(None if one is None else support_record(one, bearing, listed))
    return ContactResult(
        contact=touch.kind >= 0,
        probability=touch.probability,
        distance=near.surface.nearest,
        partner=index,
        partners=partners,
        contacts=tuple(contacts),
        supports=tuple(supports),
        parts=touch.parts,
        unseen=unseen,
    )
