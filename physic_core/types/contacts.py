"""What a body touches: partners of contact, and contacts by body part."""

from __future__ import annotations

from dataclasses import dataclass

PARTNER_KINDS = ("floor", "scene", "person", "self", "hidden", "object")
"""Kinds of :class:`ContactPartner`: the floor or ground; a part of the scene; another person; the own body; a support
that the reconstructed scene does not have, such as a seat behind the person or a thin bar; a small object in somebody's
hands or on their lap, which is not part of the scene."""

NO_PARTNER = -1
"""Entry of ``Person.contact_partner`` for a vertex that is not in contact."""


def part_words(part: str) -> str:
    """Return the name of a body part for readers: "left hand"; "buttocks" for the part "seat", unlike a seat."""
    return "buttocks" if part == "seat" else part.replace("_", " ")


@dataclass(frozen=True)
class ContactPartner:
    """One thing that people touch.

    Attributes:
        kind: one of :data:`PARTNER_KINDS`.
        surface: semantic class, one of :data:`physic_core.types.SURFACE_NAMES`; "" if no class is known.
        id: of the connected surface, for kind "scene", or of the object, for kind "object"; the same for all people who
            touch it. None otherwise.
        person: index of the person touched, for kind "person"; None otherwise.
        part: body part touched, for kinds "person" and "self"; "" otherwise.
    """

    kind: str
    surface: str = ""
    id: int | None = None
    person: int | None = None
    part: str = ""

    @property
    def title(self) -> str:
        """Name for readers: "floor", "seat", "surface 3", "left hand of person 1", "own head", "hidden seat"."""
        part = part_words(self.part) or "body"
        if self.kind == "person":
            return f"{part} of person {self.person}"
        if self.kind == "self":
            return f"own {part}"
        if self.kind == "hidden":
            return f"hidden {self.surface}" if self.surface else "hidden support"
        if self.kind == "object":
            return f"object {self.id}"
        return self.surface or ("floor" if self.kind == "floor" else f"surface {self.id}")


@dataclass(frozen=True)
class BodyContact:
    """Contact of one body part with one partner.

    Attributes:
        part: body part: "head", "torso", "back", "seat", or a limb, such as "left_hand".
        partner: what it touches.
        probability: that this part touches this partner, in [0, 1]; None if the preset estimates none.
        vertices: number of vertices in contact.
        dent_m: how deep the part presses into a surface that gives way, such as a bed: the 0.9 quantile over the
            vertices in contact, metres. None where nothing gives way.
        assumed: whether no pixel shows the part. The probability is then how often such parts touch something, and what
            this part touches is a guess.
    """

    part: str
    partner: ContactPartner
    probability: float | None
    vertices: int
    dent_m: float | None = None
    assumed: bool = False

    @property
    def likely(self) -> bool:
        """Whether the probability is at least one half, or not estimated."""
        return self.probability is None or self.probability >= 0.5

    def __str__(self) -> str:
        sure = "" if self.probability is None else f", {self.probability:.2f}"
        return f"{part_words(self.part)}: {self.partner.title}{sure}{', assumed' if self.assumed else ''}"
