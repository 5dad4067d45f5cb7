"""The colours of every picture, page and export: bodies, people, and contact by what is touched.

Readers with any of the three kinds of colour blindness can distinguish the colours of contact, and
from a body without contact: they differ by 0.13 at least in OKLab.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import ContactPartner, Float64Array, Person, Reconstruction, UInt8Array

_Rgb = tuple[int, int, int]

BODY_RGB: _Rgb = (196, 192, 186)
"""sRGB colour of body vertices without contact."""

CONTACT_RGB: _Rgb = (204, 68, 0)
"""sRGB colour of body vertices in contact, where partners are not shown or not known."""

CONTACT_PALETTE: dict[str, _Rgb] = {
    "floor": (24, 140, 130),
    "seat": (16, 72, 156),
    "wall": (124, 168, 255),
    "other surface": (250, 250, 60),
    "person": (160, 84, 224),
    "own body": (224, 150, 8),
    "object or animal": CONTACT_RGB,
    "something hidden": (84, 40, 60),
}
"""Label of a kind of contact -> sRGB colour, in the order of a legend."""

FAINT = "faint: probability below 0.5"
"""What a legend says of contact with a probability below one half."""

FLOOR_RGB: _Rgb = CONTACT_PALETTE["floor"]
"""sRGB colour of the floor, which is that of contact with it."""

CAMERA_RGB: _Rgb = (42, 111, 184)
"""sRGB colour of the camera's field of view."""

_PERSON_RGB: tuple[_Rgb, ...] = (
    (86, 156, 222),
    (240, 150, 62),
    (96, 186, 108),
    (214, 108, 158),
    (150, 122, 206),
    (222, 196, 72),
    (84, 190, 190),
    (198, 128, 96),
)
_TINT = 0.2  # share of a person's colour in their body where contact is shown on it
# The others are labels themselves.
_LABEL_OF_KIND = {
    "self": "own body",
    "object": "object or animal",
    "hidden": "something hidden",
}


def person_color(index: int) -> _Rgb:
    """Return the sRGB colour of a person; colours repeat after the eighth person."""
    return _PERSON_RGB[index % len(_PERSON_RGB)]


def person_tint(index: int) -> _Rgb:
    """Return the sRGB colour of a person's body where contact is shown on it: grey with a touch of
    their colour.
    """
    red, green, blue = (
        round(_TINT * channel + (1 - _TINT) * grey)
        for channel, grey in zip(person_color(index), BODY_RGB, strict=True)
    )
    return red, green, blue


def contact_label(partner: ContactPartner) -> str:
    """Return the label of CONTACT_PALETTE for a partner."""
    if partner.kind == "scene":
        return partner.surface if partner.surface in ("seat", "wall") else "other surface"
    return _LABEL_OF_KIND.get(partner.kind, partner.kind)


def contact_color(partner: ContactPartner) -> _Rgb:
    """Return the sRGB colour of contact with a partner."""
    return CONTACT_PALETTE[contact_label(partner)]


def contact_colors(person: Person, partners: Sequence[ContactPartner]) -> UInt8Array:
    """Return the sRGB colours (V, 3) of a body by partner; of CONTACT_RGB in a result without
    partners.

    Args:
        person: with V vertices.
        partners: those of the result.
    """
    if person.contact_partner is None:
        return np.where(person.contact[:, None], CONTACT_RGB, BODY_RGB).astype(np.uint8)
    table = np.array([*map(contact_color, partners), BODY_RGB], np.uint8)
    # -1, no partner, is the last row
    return table[np.asarray(person.contact_partner, np.int64)]


def contact_strength(person: Person) -> Float64Array:
    """Return how strongly contact is painted (V,): 1 where it is likely or has no probability, at
    most 0.25 below.
    """
    touching = np.asarray(person.contact, np.float64)
    if person.contact_probability is None:
        return touching
    probability = np.nan_to_num(np.asarray(person.contact_probability, np.float64))
    return touching * np.where(probability >= 0.5, 1.0, 0.5 * probability)


def painted_contact(person: Person, partners: Sequence[ContactPartner]) -> UInt8Array:
    """Return the colours (V, 3) of :func:`contact_colors`, faint where contact is less likely than
    not.
    """
    colors = contact_colors(person, partners)
    strength = contact_strength(person)[:, None]
    painted: UInt8Array = np.round(strength * colors + (1 - strength) * np.array(BODY_RGB)).astype(
        np.uint8
    )
    return painted


def has_faint_contact(result: Reconstruction) -> bool:
    """Whether a body of a result has contact that is painted faint, which a legend says by
    :data:`FAINT`.
    """
    strengths = (contact_strength(person) for person in result.people)
    return any(bool(((strength > 0) & (strength < 1)).any()) for strength in strengths)


def contact_legend(result: Reconstruction) -> dict[str, _Rgb]:
    """Return label -> sRGB colour of the contact that the bodies of a result show, in the order of
    CONTACT_PALETTE.
    """
    shown: set[str] = set()
    for person in result.people:
        if person.contact_partner is not None:
            touched = np.unique(person.contact_partner)
            shown.update(contact_label(result.contact_partners[i]) for i in touched if i >= 0)
        elif person.contact.any():
            shown.add("anything")
    return {
        label: rgb
        for label, rgb in {**CONTACT_PALETTE, "anything": CONTACT_RGB}.items()
        if label in shown
    }
