"""Contacts of people and their partners, to and from ``reconstruction.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from physic_core.files.strict_json import from_json
from physic_core.types import BodyContact, ContactPartner, Support, SupportState

__all__ = [
    "contact_record",
    "parse_contacts",
    "parse_partners",
    "parse_support",
    "partner_record",
    "support_record",
]


def partner_record(partner: ContactPartner) -> dict[str, Any]:
    """Return a partner ready for JSON: kind, class, id, person, person_part."""
    return {
        "kind": partner.kind,
        "class": partner.surface,
        "id": partner.id,
        "person": partner.person,
        "person_part": partner.part,
    }


def contact_record(contact: BodyContact) -> dict[str, Any]:
    """Return a contact ready for JSON: part, partner (a title for readers), the partner's entries, and numbers."""
    return {
        "part": contact.part,
        "partner": contact.partner.title,
        **partner_record(contact.partner),
        "probability": contact.probability,
        "vertices": contact.vertices,
        "dent_m": contact.dent_m,
    }


def support_record(support: Support) -> dict[str, Any]:
    """Return a support ready for JSON: state, contacts, hidden (names for readers), and numbers."""
    return {
        "state": support.state,
        "contacts": [contact_record(one) for one in support.contacts],
        "hidden": list(support.hidden),
        "outside_m": support.outside_m,
        "centre_of_mass": list(support.centre_of_mass),
    }


def parse_partners(document: Mapping[str, Any]) -> tuple[ContactPartner, ...]:
    """Parse ``contact_partners`` of a document; documents of older versions have none."""
    return tuple(_partner(record) for record in document.get("contact_partners", ()))


def parse_contacts(person: Mapping[str, Any]) -> tuple[BodyContact, ...]:
    """Parse ``contacts`` of a person's record; records of older versions have none."""
    return tuple(_contact(record) for record in person.get("contacts") or ())


def parse_support(person: Mapping[str, Any]) -> Support | None:
    """Parse ``support`` of a person's record; None without a body, or in a record of an older version."""
    record = person.get("support")
    if record is None:
        return None
    x, y, z = from_json(record["centre_of_mass"])
    contacts = tuple(_contact(one) for one in record["contacts"])
    return Support(SupportState(record["state"]), contacts, from_json(record["outside_m"]), (x, y, z))


def _contact(record: Mapping[str, Any]) -> BodyContact:
    probability, dent = from_json(record["probability"]), from_json(record.get("dent_m"))
    return BodyContact(record["part"], _partner(record), probability, record["vertices"], dent)


def _partner(record: Mapping[str, Any]) -> ContactPartner:
    return ContactPartner(record["kind"], record["class"], record["id"], record["person"], record["person_part"])
