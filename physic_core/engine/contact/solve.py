"""Stage 4: which vertices touch, what they touch, and what carries each person (paper sec. 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.contact.dents import dent_depths, largest_dents
from physic_core.engine.contact.features import KINDS, Distances, feature_columns, measure_distances
from physic_core.engine.contact.partner import HIDDEN, HIDDEN_SEAT, VertexContacts, assign_partners, body_contacts
from physic_core.engine.contact.probability import ContactModel
from physic_core.engine.contact.problem import ContactInput, ContactResult
from physic_core.engine.contact.regions import contact_regions
from physic_core.engine.contact.support import Carried, ContactEvidence, PosedPerson, find_support, support_record
from physic_core.engine.settings import ContactSettings

__all__ = ["solve_contact"]

_OWN_BODY, _OBJECT = KINDS.index("own body"), KINDS.index("object")


@dataclass(frozen=True)
class _Touch:
    """What vertices touch.

    Attributes:
        kind: (N, V) int64, index into ``KINDS``; -1 without contact.
        probability: (N, V) of contact with anything; None if the rule is the distance.
    """

    kind: Tensor
    probability: Tensor | None


def solve_contact(given: ContactInput, model: ContactModel, settings: ContactSettings) -> ContactResult:
    """Return the contact of all people. People with non-finite vertices touch nothing.

    Args:
        given: final bodies, and what they may touch.
        model: of the probability of contact.
        settings: of the stage.
    """
    near = measure_distances(given, settings)
    if settings.rule == "distance":
        touch = touch_by_distance(given, near, settings)
    else:
        touch = touch_by_probability(given, near, model, settings)
    carried = find_supports(given, near, touch, settings)
    return describe_contacts(given, near, _with_hidden(touch, carried, settings), carried, model, settings)


def touch_by_distance(given: ContactInput, near: Distances, settings: ContactSettings) -> _Touch:
    """Return the contacts of vertices whose distance is within the bounds of the settings, as published."""
    distance = near.by_kind
    within = (distance <= settings.distance_m) & (distance >= -settings.inside_m)
    within = within & given.model.outer & ~given.in_air
    return _nearest(torch.where(within, -distance.abs(), -torch.inf), within.any(0), None)


def touch_by_probability(
    given: ContactInput, near: Distances, model: ContactModel, settings: ContactSettings
) -> _Touch:
    """Return the contacts of vertices whose probability is at least the threshold of the settings."""
    probabilities = model.probabilities(feature_columns(given, near))
    in_reach = torch.isfinite(near.by_kind)
    may_touch = given.model.outer & given.finite[:, None]
    likely = torch.where(may_touch, 1 - (1 - probabilities).prod(0), 0.0)
    kind = torch.where(in_reach, probabilities, -1.0)
    skin = torch.where(in_reach, probabilities, 0.0)[1:_OBJECT].amax(0)
    on_skin = (skin >= settings.skin_threshold) & (kind.argmax(0) > 0)
    touches = ((likely >= settings.threshold) & in_reach.any(0)) | on_skin
    return _nearest(kind, touches & may_touch, likely)


def _nearest(rank: Tensor, touches: Tensor, probability: Tensor | None) -> _Touch:
    """Return the kind (N, V) of contact with the highest rank (K, N, V) where a vertex touches."""
    return _Touch(torch.where(touches, rank.argmax(0), -1), probability)


def find_supports(
    given: ContactInput, near: Distances, touch: _Touch, settings: ContactSettings
) -> tuple[Carried | None, ...]:
    """Return what carries each person; None for people with non-finite vertices."""
    outward = (touch.kind >= 0) & (touch.kind != _OWN_BODY) & (touch.kind != _OBJECT)
    seen = given.seen
    found: list[Carried | None] = []
    for i, finite in enumerate(given.finite.tolist()):
        if not finite:
            found.append(None)
            continue
        body = PosedPerson(given.vertices[i], near.normals[i], given.joints[i], given.rotations[i])
        evidence = ContactEvidence(
            contact=outward[i],
            prior=given.prior[i],
            lifted_feet=given.lifted_feet[i],
            seen=seen[i],
        )
        found.append(find_support(given.model, body, evidence, given.up, assume=settings.assume_supports))
    return tuple(found)


def _with_hidden(touch: _Touch, carried: tuple[Carried | None, ...], settings: ContactSettings) -> _Touch:
    """Return the contacts with those of hidden supports, whose probability is at least the threshold."""
    kind, probability = touch.kind.clone(), None if touch.probability is None else touch.probability.clone()
    for i, one in enumerate(carried):
        if one is not None:
            kind[i, one.hidden] = HIDDEN_SEAT if one.hidden_is_seat else HIDDEN
            if probability is not None:
                probability[i, one.hidden] = probability[i, one.hidden].clamp(min=settings.threshold)
    return _Touch(kind, probability)


def describe_contacts(
    given: ContactInput,
    near: Distances,
    touch: _Touch,
    carried: tuple[Carried | None, ...],
    model: ContactModel,
    settings: ContactSettings,
) -> ContactResult:
    """Name partners and supports, and list the contacts of each body part."""
    regions = contact_regions(given.model)
    partners, index = assign_partners(touch.kind, near, regions)
    give = largest_dents(near.surface, near.parts)
    dents = dent_depths(given.vertices, given.uncarved, give, settings)
    dents = torch.where(touch.kind == KINDS.index("scene"), dents, torch.nan)
    contacts, supports = [], []
    for i, one in enumerate(carried):
        carrying = torch.zeros_like(given.model.outer) if one is None else one.contact | one.hidden
        likely = None if touch.probability is None else touch.probability[i]
        person = VertexContacts(index[i], likely, dents[i])
        contacts.append(body_contacts(person, partners, regions, model, least=settings.threshold))
        own = VertexContacts(torch.where(carrying, index[i], -1), None, dents[i])
        parts = body_contacts(own, partners, regions)
        supports.append(None if one is None else support_record(one, parts, contacts[-1]))
    return ContactResult(
        contact=touch.kind >= 0,
        probability=touch.probability,
        distance=near.surface.nearest,
        give=give,
        partner=index,
        partners=partners,
        contacts=tuple(contacts),
        supports=tuple(supports),
    )
