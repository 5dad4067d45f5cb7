"""Colours of contact by what is touched: one per kind of partner, and one per common class of a surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import ContactPartner, Person, UInt8Array

__all__ = ["BODY_RGB", "CONTACT_RGB", "contact_colors", "partner_color", "partner_legend"]

BODY_RGB = (196, 192, 186)
"""sRGB colour of body vertices without contact."""

CONTACT_RGB = (214, 62, 46)
"""sRGB colour of body vertices in contact, where partners are not shown or unknown."""

_OF_KIND = {
    "floor": (42, 140, 84),
    "person": (200, 58, 150),
    "self": (206, 176, 28),
    "hidden": (120, 74, 48),
    "object": (96, 128, 152),
}
_OF_SURFACE = {
    "seat": (46, 104, 200),
    "bed": (110, 84, 196),
    "table": (222, 132, 30),
    "cabinet": (150, 104, 62),
    "wall": (40, 156, 172),
    "stairs": (118, 150, 44),
}


def partner_color(partner: ContactPartner) -> tuple[int, int, int]:
    """Return the sRGB colour of a partner; surfaces of rare or unknown class have that of contact, red."""
    return _OF_KIND.get(partner.kind) or _OF_SURFACE.get(partner.surface, CONTACT_RGB)


def contact_colors(person: Person, partners: Sequence[ContactPartner]) -> UInt8Array:
    """Return the sRGB colours (V, 3) of a body by partner; contact is red in a result without partners."""
    if person.contact_partner is None:
        return np.where(person.contact[:, None], CONTACT_RGB, BODY_RGB).astype(np.uint8)
    table = np.array([*(partner_color(partner) for partner in partners), BODY_RGB], np.uint8)
    colors: UInt8Array = table[np.asarray(person.contact_partner, np.int64)]  # -1, no partner, is the last row
    return colors


def partner_legend(partners: Sequence[ContactPartner]) -> dict[str, tuple[int, int, int]]:
    """Return name -> colour of the partners of a result: kinds and classes, without ids and people."""
    legend: dict[str, tuple[int, int, int]] = {}
    for partner in partners:
        name = partner.surface if partner.kind in ("floor", "scene") else partner.kind
        legend.setdefault(name or "scene", partner_color(partner))
    return legend
