"""Which body parts touch the world: probabilities against measured forces, and labels by eye."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types.skeletons import SIDES
from physic_testing.metrics import ValueWithInterval, markdown_table

from .measures import SCORES, probability_scores
from .sets import FILMS_APART, FILMS_OF_FITS, Sample
from .statistics import Record, Strata, figure, pooled
from .table import Row

if TYPE_CHECKING:
    Answer = Mapping[str, Any]

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
    kind = KINDS[part.rpartition("_")[2]]
    return {
        **of,
        "part": part,
        "kind": kind,
        "probability": float(probability),
        "touches": bool(touches),
    }


def film_records(samples: Sequence[Sample], answers: Sequence[Answer]) -> list[dict[str, Any]]:
    """Of each film of parkour, the median camera height of frames where no foot touches over that
    of the others.
    """
    heights: dict[str, dict[bool, list[float]]] = {}
    for sample, answer in zip(samples, answers, strict=True):
        if sample.set != "parkour" or answer["floor"] is None:
            continue
        touches = [sample.truth["touches"][foot] for foot in ("l_ankle", "r_ankle")]
        if any(touches) or not any(
            sample.truth["uncaptured"][foot] for foot in ("l_ankle", "r_ankle")
        ):
            of_film = heights.setdefault(sample.group, {True: [], False: []})
            of_film[any(touches)].append(float(answer["floor"][3]))
    return [
        {
            "set": "parkour",
            "photo": film,
            "group": film,
            "frames": {"stands": len(found[True]), "in_air": len(found[False])},
            "ratio": float(np.median(found[False]) / np.median(found[True])),
        }
        for film, found in heights.items()
        if found[True] and found[False]
    ]


def film_rows(films: Sequence[Record]) -> list[Row]:
    """Rows about the floor under people who hang or jump."""
    rows = []
    for words, names in FILMS.items():
        mine = [r for r in films if r["group"] in names]
        name = f"camera height where no foot touches / where one does, {words}"
        rows.append(Row(name, figure(mine, pooled("ratio")), ".85-1.15", ".2f"))
    return rows


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
                scores = {name: asdict(figure(mine, _score(name))) for name in SCORES}
                tables.setdefault(group, {})[kind] = {
                    **scores,
                    "touching": sum(r["touches"] for r in mine),
                }
    return tables


def table_of_parts(tables: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """As Markdown: a line for each kind of part, each score with its interval."""
    heads = [
        "judged",
        "touch",
        "AUC",
        "Brier",
        "Brier, constant",
        "recall",
        "specificity",
        "balanced",
        "F1",
    ]
    heads.append("calibration error")
    rows = [["contact with the world", *heads]]
    for group, kinds in tables.items():
        for kind, scores in kinds.items():
            counts = [str(scores["auc"]["count"]), str(scores["touching"])]
            cells = [
                _cell(ValueWithInterval(**scores[name]), name != "constant") for name in SCORES
            ]
            rows.append([f"{group}: {kind}", *counts, *cells])
    return markdown_table(rows)


def _cell(found: ValueWithInterval, interval: bool) -> str:
    if not math.isfinite(found.value):
        return "-"
    around = (
        f" ({found.low:.2f} .. {found.high:.2f})" if interval and math.isfinite(found.low) else ""
    )
    return f"{found.value:.3f}{around}"


def _score(name: str) -> Any:
    def score(strata: Strata) -> float:
        mine = [r for stratum in strata for r in stratum]
        return probability_scores([r["probability"] for r in mine], [r["touches"] for r in mine])[
            name
        ]

    return score
