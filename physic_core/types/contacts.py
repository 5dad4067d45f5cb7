"""Contacts of a body by body part, and the support of a person."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from enum import StrEnum

from physic_core.types.people import CARRIER_NAMES, GROUND_SURFACES

PARTNER_KINDS = ("floor", "scene", "person", "self", "object", "hidden")
"""Kinds of :class:`ContactPartner`: the floor or ground; a part of the scene; another person; the
own body; an object or an animal that a hand holds or pets, which carries no one; something that the
picture does not show, such as a seat behind the person.
"""

NO_PARTNER = -1
"""Entry of ``Person.contact_partner`` for a vertex that is not in contact."""


def part_words(part: str) -> str:
    """Return the name of a body part for readers: "left hand"; "buttocks" for the part "seat",
    unlike a seat.
    """
    return "buttocks" if part == "seat" else part.replace("_", " ")


@dataclass(frozen=True)
class ContactPartner:
    """One thing that people touch.

    Attributes:
        kind: one of :data:`PARTNER_KINDS`.
        surface: semantic class, one of :data:`physic_core.types.SURFACE_NAMES`, or of
            :data:`physic_core.types.CARRIER_NAMES`; "" if no class is known.
        id: of the connected surface or the carrier; the same for all people who touch it. None
            otherwise: the picture shows a part of the scene, such as a floor whose plane is not
            found, and it has no place in 3D.
        person: index of the person touched, for kind "person"; None otherwise.
        part: body part touched, for kinds "person" and "self"; "" otherwise.

    Raises:
        ValueError: the kind is none of these.
    """

    kind: str
    surface: str = ""
    id: int | None = None
    person: int | None = None
    part: str = ""

    def __post_init__(self) -> None:
        if self.kind not in PARTNER_KINDS:
            raise ValueError(f"'{self.kind}' is not a kind of contact partner: {PARTNER_KINDS}")

    @property
    def in_scene(self) -> bool:
        """Whether the reconstructed scene has it, and not the picture alone, or nothing."""
        return self.kind != "hidden" and (self.kind != "scene" or self.id is not None)

    @property
    def title(self) -> str:
        """Name for readers: "floor", "seat", "unnamed surface 3", "something seen", "left hand of
        person 1", "own head", "object or animal", "hidden seat", "something hidden", "bicycle".
        """
        part = part_words(self.part) or "body"
        if self.kind == "person":
            return f"{part} of person {self.person}"
        if self.kind == "self":
            return f"own {part}"
        if self.kind == "object":
            return "object or animal"
        if self.kind == "hidden" and self.surface not in CARRIER_NAMES:
            return f"hidden {self.surface}" if self.surface else "something hidden"
        if not self.surface and self.kind == "scene":
            return "something seen" if self.id is None else f"unnamed surface {self.id}"
        return self.surface or "floor"


def partner_titles(partners: Iterable[ContactPartner]) -> dict[ContactPartner, str]:
    """Return the name for readers of each partner: its title, with its id where another has this
    title ("seat 3").
    """
    distinct = dict.fromkeys(partners)
    count = Counter(title for title, _ in {(one.title, one.id) for one in distinct})
    return {
        one: one.title if one.id is None or count[one.title] == 1 else f"{one.title} {one.id}"
        for one in distinct
    }


@dataclass(frozen=True)
class BodyContact:
    """Contact of one body part with one partner.

    Attributes:
        part: body part: "head", "torso", "back", "seat", or a limb, such as "left_hand".
        partner: what it touches.
        probability: that this part touches this partner, in [0, 1]; None if the preset estimates
            none.
        vertices: number of vertices in contact.
        dent_m: how deep the part presses into a surface that gives way, such as a bed: the 0.9
            quantile over the vertices in contact, meters. None where nothing gives way.
        assumed: whether nothing shows the part. What it touches is then a guess, and the
            probability is mostly that of such parts.
        distance_m: of a part that surely touches something of which the scene has no surface within
            a hand's breadth from the nearest surface, meters; the radius of the search, 0.15, if
            none is within it. Of skin, that of the other part beyond this. None otherwise.
    """

    part: str
    partner: ContactPartner
    probability: float | None
    vertices: int
    dent_m: float | None = None
    assumed: bool = False
    distance_m: float | None = None

    @property
    def likely(self) -> bool:
        """Whether the probability is at least one half, or not estimated."""
        return self.probability is None or self.probability >= 0.5

    @property
    def far(self) -> str:
        """How far off what is touched is: "nearest surface at least 0.12 m off", of skin "0.12 m
        apart"; "" if it is near.
        """
        if not self.distance_m:
            return ""
        apart = f"{self.distance_m:.2f} m"
        return f"{apart} apart" if self.partner.part else f"nearest surface at least {apart} off"

    def text(self, partner: str) -> str:
        """Return "left foot: floor, 0.97", with this name of the partner."""
        sure = "" if self.probability is None else f", {self.probability:.2f}"
        far = f" ({self.far})" if self.far else ""
        assumed = " (assumed: hidden)" if self.assumed else ""
        return f"{part_words(self.part)}: {partner}{far}{sure}{assumed}"

    def __str__(self) -> str:
        return self.text(self.partner.title)


def has_sole_on_floor(contacts: Iterable[BodyContact]) -> bool:
    """Return whether the contacts of a person show a foot that probably touches the floor."""
    return any(
        one.likely
        and not one.assumed
        and one.partner.surface in GROUND_SURFACES
        and one.part in ("left_foot", "right_foot")
        for one in contacts
    )


def contacts_text(
    contacts: Collection[BodyContact], *, likely: bool = True, assumed: bool | None = None
) -> str:
    """Return some contacts of a person as one text, "left foot: floor, 0.97; ...".

    Args:
        contacts: all of the person, by which surfaces of one class are distinguished.
        likely: whether the likely ones are wanted, or the others.
        assumed: whether those of parts that no pixel shows are wanted, or the others; None for
            both.
    """
    titles = partner_titles(one.partner for one in contacts)
    chosen = (one for one in contacts if one.likely == likely and assumed in (None, one.assumed))
    return "; ".join(one.text(titles[one.partner]) for one in chosen)


_HIDDEN_BELOW = {
    "foot": "feet",
    "lower_leg": "knees",
    "upper_leg": "thighs",
    "lower_arm": "arms",
    "upper_arm": "arms",
    "torso": "body",
}


class SupportState(StrEnum):
    """Kind of support of a person."""

    BALANCED = "balanced"
    """The center of mass is over contacts with floor, scene or other people."""

    UNSTEADY = "unsteady"
    """The center of mass is over contacts of feet alone, whose heels rest on too little ground to
    stay up: the person moves, or may fall in a simulation.
    """

    HANGING = "hanging"
    """The hands hold something above the center of mass."""

    ASSUMED = "assumed"
    """The same with a support that the photo does not show: contacts of limbs without a visible
    pixel, or a hidden support, which the body needs and the reconstructed scene does not have.
    """

    AIRBORNE = "airborne"
    """The person is in the air: the photo shows both feet over the ground, and nothing else is
    touched.
    """

    UNBALANCED = "unbalanced"
    """No support balances the body: the person moves, or the pose is wrong."""


@dataclass(frozen=True)
class Support:
    """Support of one person.

    Attributes:
        state: a :class:`SupportState` or its value.
        contacts: the contacts that carry, hidden ones included, most probable first.
        outside_m: horizontal distance of the center of mass from the convex hull of these contacts,
            meters; negative inside. None without such contacts.
        centre_of_mass: x, y, z in the camera frame, meters, of a body of uniform density.
    """

    state: SupportState
    contacts: tuple[BodyContact, ...]
    outside_m: float | None
    centre_of_mass: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", SupportState(self.state))

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of the hidden supports: "hidden seat", "hidden handhold", "hidden support under the
        feet", ...
        """
        return tuple(
            dict.fromkeys(_hidden(one) for one in self.contacts if one.partner.kind == "hidden")
        )

    def __str__(self) -> str:
        largest = sorted(self.contacts, key=lambda one: -one.vertices)
        titles = partner_titles(one.partner for one in self.contacts)
        on = {
            one.part: titles[one.partner]
            for one in reversed(largest)
            if one.partner.kind != "hidden"
        }
        touches = [
            f"{part_words(part)} on {on[part]}"
            for part in dict.fromkeys(one.part for one in self.contacts)
            if part in on
        ]
        unseen = [
            f"a {name.removeprefix('hidden ')} that the scene does not show" for name in self.hidden
        ]
        return ": ".join(filter(None, (self.state.value, ", ".join([*touches, *unseen]))))


def _hidden(contact: BodyContact) -> str:
    """Return the name of a hidden support by what it is, else by the body part that it carries."""
    limb = contact.part.removeprefix("left_").removeprefix("right_")
    if contact.partner.surface:
        return f"hidden {contact.partner.surface}"
    if limb == "hand":
        return "hidden handhold"
    if limb == "back":
        return "hidden support behind the back"
    return f"hidden support under the {_HIDDEN_BELOW.get(limb, limb)}"
