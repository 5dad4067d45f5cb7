"""With what each contact vertex is in contact: floor, part of the scene, skin, held object, or a hidden support."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.contact.distance import SurfaceDistances
from physic_core.engine.contact.probability import ASSUMED_HOLD
from physic_core.engine.contact.regions import are_adjacent, is_farther_out
from physic_core.engine.contact.scene_parts import SceneParts
from physic_core.engine.contact.skin import SkinContacts
from physic_core.types.contacts import NO_PARTNER, BodyContact, ContactPartner

__all__ = ["ContactPartners", "assign_partners", "body_contacts"]

_MIN_VERTICES = 3  # of a contact that is listed
_DENT_QUANTILE = 0.9  # of the depths of a part's vertices in a dent
_TOP_SHARE = 10  # vertices whose mean probability is that of the body part


@dataclass(frozen=True)
class ContactPartners:
    """Partners of the contacts of N people.

    Attributes:
        table: all partners.
        index: (N, V) int16, index into ``table``; :data:`NO_PARTNER` without contact.
    """

    table: tuple[ContactPartner, ...]
    index: Tensor


def assign_partners(
    contact: Tensor,
    surfaces: SurfaceDistances,
    parts: SceneParts,
    on_people: SkinContacts,
    on_self: SkinContacts,
    hidden: Tensor,
    on_object: Tensor,
    region_names: Sequence[str],
    region: Tensor,
) -> ContactPartners:
    """Name the partner of each contact vertex.

    Args:
        contact: (N, V) bool.
        surfaces: distances (N, V) to scene and floor.
        parts: of the scene's points, to which ``surfaces.point`` refers.
        on_people: contacts with other people.
        on_self: contacts with the own body.
        hidden: (N, V) int64, contacts with an assumed support: 0 none, 1 seat, 2 anything that a hand holds.
        on_object: (N, V) int64, index of the object that a vertex touches; -1 for none.
        region_names: of the body parts.
        region: (V,) int64, body part of each vertex, index into ``region_names``.
    """
    index = torch.full(contact.shape, NO_PARTNER, dtype=torch.int16, device=contact.device)
    table: list[ContactPartner] = []

    def add(rows: Tensor, partner: ContactPartner) -> None:
        if bool(rows.any()):
            index[rows] = len(table)
            table.append(partner)

    on_person, on_own, assumed = (touch & contact for touch in (on_people.touching, on_self.touching, hidden > 0))
    held = contact & (on_object >= 0) & ~on_person & ~on_own & ~assumed
    on_scene = contact & ~on_person & ~on_own & ~assumed & ~held
    ground = surfaces.on_floor
    if len(parts.ground):
        ground = ground | (torch.isfinite(surfaces.scene) & parts.ground[surfaces.point])
    add(on_scene & ground, ContactPartner("floor", "floor"))
    on_scene = on_scene & ~ground
    if bool(on_scene.any()):
        touched = parts.surface[surfaces.point]
        for number, surface in enumerate(torch.unique(touched[on_scene]).tolist()):
            rows = on_scene & (touched == surface)
            label = int(parts.label[surfaces.point[rows]].mode().values)
            add(rows, ContactPartner("scene", parts.names[label] if label >= 0 else "", id=number))
    for kind, touch, skin in (("person", on_person, on_people.skin), ("self", on_own, on_self.skin)):
        person = skin.person if kind == "person" else torch.zeros_like(skin.person)
        pair = person * len(region_names) + region[skin.vertex]
        for code in torch.unique(pair[touch]).tolist():
            other, part = divmod(code, len(region_names))
            partner = ContactPartner(kind, person=other if kind == "person" else None, part=region_names[part])
            add(touch & (pair == code), partner)
    for number in torch.unique(on_object[held]).tolist():
        add(held & (on_object == number), ContactPartner("object", "object", id=number))
    add(assumed & (hidden == 1), ContactPartner("hidden", "seat"))
    add(assumed & (hidden == 2), ContactPartner("hidden"))
    return ContactPartners(tuple(table), index)


def body_contacts(
    index: Tensor,
    probability: Tensor | None,
    table: Sequence[ContactPartner],
    region_names: Sequence[str],
    region: Tensor,
    *,
    dent: Tensor | None = None,
    least: float = 0.0,
) -> tuple[BodyContact, ...]:
    """List the contacts of one person by body part, most probable first.

    The probability of a part is the mean of its ten most probable vertices, that of a hand at a hidden support at least
    :data:`ASSUMED_HOLD`. Contacts of fewer than three vertices are not listed, nor those of adjacent parts of the own
    body, such as an arm and the torso. Two parts of the own body that touch each other are listed once, from the part
    that is farther out.

    Args:
        index: (V,) index into ``table``, :data:`NO_PARTNER` without contact.
        probability: (V,) of contact, or None.
        table: partners.
        region_names: of the body parts.
        region: (V,) int64, body part of each vertex.
        dent: (V,) depth of the dent at each vertex, metres; NaN where nothing gives way. None without dents.
        least: smallest probability of a part that is listed.
    """
    touching = index >= 0
    code = index.long() * len(region_names) + region
    found = []
    for value, count in zip(*(x.tolist() for x in torch.unique(code[touching], return_counts=True)), strict=True):
        if count < _MIN_VERTICES:
            continue
        partner, part = divmod(value, len(region_names))
        sure = None
        if probability is not None:
            likely = probability[touching & (code == value)]
            sure = round(float(likely.topk(min(_TOP_SHARE, len(likely))).values.mean()), 4)
            if table[partner].kind == "hidden" and region_names[part].endswith("hand"):
                sure = max(sure, ASSUMED_HOLD)
        here = touching & (code == value)
        deep = None if dent is None else _dent_of(dent[here])
        if sure is None or sure >= least:
            found.append(BodyContact(region_names[part], table[partner], sure, count, deep))
    on_self = {(one.part, one.partner.part) for one in found if one.partner.kind == "self"}
    found = [one for one in found if one.partner.kind != "self" or _is_listed(one.part, one.partner.part, on_self)]
    return tuple(sorted(found, key=lambda one: (-(one.probability or 0.0), -one.vertices)))


def _is_listed(part: str, other: str, pairs: Collection[tuple[str, str]]) -> bool:
    """Return whether the contact of a part with another of the own body is listed, among all such pairs."""
    if are_adjacent(part, other):
        return False
    return (other, part) not in pairs or is_farther_out(part, other)


def _dent_of(depths: Tensor) -> float | None:
    """Return the depth of a dent with depths (n,) of its vertices; None if too few of them give way."""
    known = depths[torch.isfinite(depths)]
    return round(float(known.quantile(_DENT_QUANTILE)), 4) if len(known) >= _MIN_VERTICES else None
