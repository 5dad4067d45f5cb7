"""Which body parts touch the world: probabilities against measured forces, and labels by eye."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from physic_core.types.skeletons import SIDES
from physic_testing.metrics import ValueWithInterval, markdown_table

from .measures import SCORES, probability_scores
from .sets import FILMS_APART, FILMS_OF_FITS, Sample
from .statistics import Record, Strata, figure

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

FILMS = {"films of fits": FILMS_OF_FITS, "films that take no part in any fit": FILMS_APART}


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


def part_tables(parts: Sequence[Record]) -> dict[str, dict[str, dict[str, Any]]]:
    """Figures of each score: group of photos -> kind of part -> score, and "touching", the number
    that touch.
    """
    groups = {
        f"parkour, {words}": [r for r in parts if r["group"] in names]
        for words, names in FILMS.items()
    }
    known = {film for names in FILMS.values() for film in names}
    groups["parkour, other films"] = [r for r in parts if r["group"] not in known]
    tables: dict[str, dict[str, dict[str, Any]]] = {}
    for group, records in groups.items():
        for kind in KINDS.values():
            if mine := [r for r in records if r["kind"] == kind]:
                scores = {name: figure(mine, _score(name)) for name in SCORES}
                tables.setdefault(group, {})[kind] = {
                    **scores,
                    "touching": sum(r["touches"] for r in mine),
                }
    return tables


def table_of_parts(tables: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """As Markdown: a line for each kind of part, each score with its interval."""
    rows = [["contact with the world", "judged", "touch", *SCORES]]
    for group, kinds in tables.items():
        for kind, scores in kinds.items():
            counts = [str(scores["auc"].count), str(scores["touching"])]
            cells = [_cell(scores[name], name != "constant") for name in SCORES]
            rows.append([f"{group}: {kind}", *counts, *cells])
    return markdown_table(rows)


def _cell(found: ValueWithInterval, with_interval: bool) -> str:
    if not math.isfinite(found.value):
        return "-"
    around = (
        f" ({found.low:.2f} .. {found.high:.2f})"
        if with_interval and math.isfinite(found.low)
        else ""
    )
    return f"{found.value:.3f}{around}"


def _score(name: str) -> Any:
    def score(strata: Strata) -> float:
        mine = [r for stratum in strata for r in stratum]
        return probability_scores([r["probability"] for r in mine], [r["touches"] for r in mine])[
            name
        ]

    return score
