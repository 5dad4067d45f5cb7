"""Which body parts touch the world: labels, and records of parts that were judged."""

from __future__ import annotations

from typing import Any

from physic_core.types.skeletons import SIDES

from .sets import Sample

WORLD = ("floor", "seat", "wall", "support")
OTHER = ("none", "own", "object", "person")
TOUCHES = dict.fromkeys(WORLD, True) | dict.fromkeys(OTHER, False)
"""Label of a body part -> whether it touches the world."""

_WORDS = {"forearm": "lower_arm", "knee": "lower_leg"}
KINDS = {
    "foot": "feet",
    "hand": "hands",
    "seat": "seat",
    "back": "back",
    "knee": "knees",
    "forearm": "forearms",
}

OF_RESULTS = {
    **{f"{side}_{one}": f"{side}_{other}" for side in SIDES for one, other in _WORDS.items()},
    "front": "torso",
}
"""Label of a body part -> the part of ``Person.world_contact``, where they differ."""

MIN_IOU = 0.4
"""Overlap of the boxes of a labelled and a found person from which they are one."""


def part_record(
    sample: Sample, person: str, part: str, probability: float, touches: bool
) -> dict[str, Any]:
    """A body part that was judged, such as "left_foot", and its probability of touching the
    world.
    """
    of = {"set": sample.set, "photo": sample.name, "group": sample.group, "person": person}
    word = part.rpartition("_")[2]
    kind = KINDS.get(word, word)
    return {
        **of,
        "part": part,
        "kind": kind,
        "probability": float(probability),
        "touches": bool(touches),
    }
