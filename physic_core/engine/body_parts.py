"""Body parts that touch, with seat and back as parts of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from physic_core.types.observations import TOUCH_PARTS

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel

SEAT = "seat"
"""Part of the buttocks: what people sit on."""

_OWN_REGIONS = {"gluteus": SEAT, "back": "back"}
_TRUNK = ("torso", *_OWN_REGIONS.values())
_CHAINS = (("hand", "lower_arm", "upper_arm"), ("foot", "lower_leg", "upper_leg"))
_OUTER_FIRST = ("hand", "lower_arm", "foot", "lower_leg", "upper_arm", "head", "upper_leg", *_TRUNK)

OBSERVED = {
    part.replace("knee", "lower_leg").replace("forearm", "lower_arm"): row
    for row, part in enumerate(TOUCH_PARTS)
}
"""Part of which the observer speaks -> row of :data:`physic_core.types.TOUCH_PARTS`."""


class ContactRegions(NamedTuple):
    """Body parts.

    Attributes:
        names: of the parts.
        region: (V,) int64, part of each vertex, index into ``names``.
    """

    names: tuple[str, ...]
    region: Tensor


def contact_regions(model: BodyModel) -> ContactRegions:
    """Return the body parts of contacts."""
    names = (*model.part_names, *_OWN_REGIONS.values())
    region = model.part_of_vertex.clone()
    for contact_set, name in _OWN_REGIONS.items():
        region[model.contact_sets[contact_set]] = names.index(name)
    return ContactRegions(names, region)


def are_adjacent(part: str, other: str) -> bool:
    """Return whether two parts of one body meet at a joint, or are both thighs: their skin touches
    in many poses.
    """
    side, name = _split_part(part)
    other_side, other_name = _split_part(other)
    if name in _TRUNK or other_name in _TRUNK:
        return {name, other_name} <= {*_TRUNK, "head", *(chain[-1] for chain in _CHAINS)}
    if name == other_name:
        return side == other_side or name == "upper_leg"
    chain = next((chain for chain in _CHAINS if name in chain), ())
    return (
        side == other_side
        and other_name in chain
        and abs(chain.index(name) - chain.index(other_name)) == 1
    )


def is_farther_out(part: str, other: str) -> bool:
    """Return whether a part is more distal than another; of two equal ones, the left one is."""
    keys = [(_OUTER_FIRST.index(name), side) for side, name in map(_split_part, (part, other))]
    return keys[0] < keys[1]


def _split_part(part: str) -> tuple[str, str]:
    """Return side and name of a part, such as ("left", "hand"); no side for the trunk and the
    head.
    """
    side, _, name = part.partition("_")
    return (side, name) if name else ("", part)
