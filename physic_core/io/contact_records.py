"""Contacts of people and their partners, to and from ``reconstruction.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from physic_core.files.strict_json import from_json
from physic_core.types import BodyContact, ContactPartner

__all__ = ["contact_record", "parse_contacts", "parse_partners", "partner_record"]


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
    }


def parse_partners(document: Mapping[str, Any]) -> tuple[ContactPartner, ...]:
    """Parse ``contact_partners`` of a document; documents of older versions have none."""
    return tuple(_partner(record) for record in document.get("contact_partners", ()))


def parse_contacts(person: Mapping[str, Any]) -> tuple[BodyContact, ...]:
    """Parse ``contacts`` of a person's record; records of older versions have none."""
    return tuple(
        BodyContact(record["part"], _partner(record), from_json(record["probability"]), record["vertices"])
        for record in person.get("contacts") or ()
    )


def _partner(record: Mapping[str, Any]) -> ContactPartner:
    return ContactPartner(record["kind"], record["class"], record["id"], record["person"], record["person_part"])
