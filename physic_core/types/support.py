"""What carries a person: supporting contacts, hidden supports, and the balance of the body over them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from physic_core.types.contacts import BodyContact, part_words

_HIDDEN_BELOW = {
    "foot": "feet",
    "lower_leg": "knees",
    "upper_leg": "thighs",
    "lower_arm": "arms",
    "upper_arm": "arms",
    "torso": "body",
}


class SupportState(StrEnum):
    """How a person is carried."""

    BALANCED = "balanced"
    """The centre of mass is over contacts with floor, scene or other people."""

    HANGING = "hanging"
    """The hands hold something above the centre of mass."""

    ASSUMED = "assumed"
    """The same with a support that the photo does not show: contacts of limbs without a visible pixel, or a hidden
    support, which the body needs and the reconstructed scene does not have."""

    AIRBORNE = "airborne"
    """The person is in the air: the photo shows both feet over the ground, and nothing else is touched."""

    UNBALANCED = "unbalanced"
    """No support balances the body: the person moves, or the pose is wrong."""


@dataclass(frozen=True)
class Support:
    """Support of one person.

    Attributes:
        state: a :class:`SupportState` or its value.
        contacts: the contacts that carry, hidden ones included, most probable first.
        outside_m: horizontal distance of the centre of mass from the convex hull of these contacts, metres; negative
            inside. None without such contacts.
        centre_of_mass: x, y, z in the camera frame, metres, of a body of uniform density.
    """

    state: SupportState
    contacts: tuple[BodyContact, ...]
    outside_m: float | None
    centre_of_mass: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", SupportState(self.state))

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of the hidden supports: "hidden seat", "hidden handhold", "hidden support under the feet", ..."""
        return tuple(dict.fromkeys(_hidden(one) for one in self.contacts if one.partner.kind == "hidden"))

    def __str__(self) -> str:
        largest = sorted(self.contacts, key=lambda one: -one.vertices)
        on = {one.part: one.partner.title for one in reversed(largest) if one.partner.kind != "hidden"}
        seen = [
            f"{part_words(part)} on {on[part]}"
            for part in dict.fromkeys(one.part for one in self.contacts)
            if part in on
        ]
        unseen = [f"a {name.removeprefix('hidden ')} that the scene does not show" for name in self.hidden]
        return ": ".join(filter(None, (self.state.value, ", ".join([*seen, *unseen]))))


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
