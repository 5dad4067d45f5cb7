"""Compare this build with another checkout, on the same photos: paired differences, with intervals
by person, on one page.

The other build runs in its own interpreter, through ``Pipeline`` alone. Answers are kept in
``--out`` by the commit of their build, so that a second comparison runs what is new. The exit code
is 1 if a figure is worse by more than its limit with its whole interval above 0.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.same_photo import PHOTO, VARIANTS, Variant, answer_of, change, same_people
from physic_testing.metrics import match_by_boxes

from .builds import ROOT, Build, Question, asked, build_of, measured_of, question_of
from .contact import MIN_IOU, OF_RESULTS, TOUCHES, part_record
from .layouts import STRIPS, TILES, says_several
from .pairs import Figure, Pair, Row, Verdict, compare, page, paired, percentile
from .scores import compared
from .sets import SETS, Sample
from .table import figures_of, touch_figure

if TYPE_CHECKING:
    from types import SimpleNamespace

_Record = Mapping[str, Any]

MOST_PEOPLE = 4
"""Labeled people of a photo with labels of touch."""

CROWDS = ("lisa__jackma",)
"""Photos of more people, most of whom are not labeled: twenty take minutes."""


@dataclass(frozen=True)
class Size:
    """How much a comparison runs.

    Attributes:
        photos: of each data set.
        labelled: photos with labels of touch.
        changed: how many of them are run with every variant, too.
        variants: names.
        strips: layouts.
        tiles: layouts.
    """

    photos: Mapping[str, int]
    labelled: int
    changed: int
    variants: tuple[str, ...]
    strips: int
    tiles: int


_SHORT = {"mpi_inf_3dhp": 4, "panoptic": 10, "roundtable": 0, "people2d": 4, "parkour": 7}
_FULL = {"mpi_inf_3dhp": 4, "panoptic": 25, "roundtable": 5, "people2d": 12, "parkour": 14}
SIZES = {
    "short": Size({**_SHORT, "rgbd": 1}, 8, 4, ("mirror", "scale", "jpeg"), 4, 2),
    "full": Size({**_FULL, "rgbd": 4}, 24, 8, tuple(v.name for v in VARIANTS), 8, 4),
}
"""The short one takes 25 minutes on two cores, the full one 60."""


@dataclass(frozen=True)
class Case:
    """A sample with what it asks."""

    sample: Sample
    question: Question


@dataclass(frozen=True)
class Plan:
    """All pictures of a comparison.

    Attributes:
        measured: photos with measured truth.
        labelled: photos with labels of touch.
        changed: number of a labelled photo, variant, question.
        files: whether a file shows several pictures, question.
    """

    measured: Sequence[Case]
    labelled: Sequence[Case]
    changed: Sequence[tuple[int, Variant, Question]]
    files: Sequence[Question]

    @property
    def questions(self) -> list[Question]:
        """In the order of the answers."""
        return [
            *(case.question for case in (*self.measured, *self.labelled)),
            *(question for _, _, question in self.changed),
            *self.files,
        ]


def main(data: Sequence[Path], other: Path, out: Path, size: str, options: Sequence[Any]) -> int:
    """Run both builds and write the page.

    Args:
        data: folders of the data sets, and the folder with "contact" and "photos".
        other: checkout of the other build.
        out: folder of answers and page.
        size: name in :data:`SIZES`.
        options: preset of both builds, settings of this one.
    """
    preset, settings = options
    builds = build_of(other, preset), build_of(ROOT, preset, settings)
    plan = plan_of(data, SIZES[size])
    if not plan.questions:
        print("No data found: nothing to compare. See benchmarks/README.md.")
        return 0
    rows = rows_of(plan, *both_answers(builds, plan.questions, out))
    before, after = builds
    title = f"{after.commit} against {before.commit}"
    counts = f"{len(plan.questions)} pictures, sample `{size}`, preset `{preset}`."
    text = page(rows, title, [" ".join([counts, *settings])])
    (out / "against.md").write_text(text + "\n")
    print(text)
    return int(any(row.verdict is Verdict.WORSE for row in rows))


def both_answers(
    builds: Sequence[Build], questions: Sequence[Question], out: Path
) -> list[list[SimpleNamespace]]:
    """Return the answers of both builds, which run side by side."""

    def answers(build: Build, title: str) -> list[SimpleNamespace]:
        with asked(build, out, title) as ask:
            return [ask(question) for question in questions]

    with ThreadPoolExecutor(len(builds)) as pool:
        return list(pool.map(answers, builds, ("other", "this")))


def plan_of(data: Sequence[Path], size: Size) -> Plan:
    """Return what is there of the photos of a size."""
    samples = [
        sample
        for name, read in SETS.items()
        for folder in data
        if (folder / name).is_dir()
        for sample in read(folder / name)[: size.photos[name]]
    ]
    labelled: list[Sample] = []
    for folder in data:
        if (folder / "contact").is_dir():
            from benchmarks.contact_on_photos import samples_of

            labelled += drawn(samples_of(folder), size.labelled)
    cases = [Case(sample, question_of(sample)) for sample in labelled]
    pictures = [case.question.picture for case in cases]
    variants = [variant for variant in VARIANTS if variant.name in size.variants]
    changed = [
        (i, variant, Question(f"{cases[i].question.name} {variant.name}", variant.picture(picture)))
        for i, picture in enumerate(pictures[: size.changed])
        for variant in variants
    ]
    layouts = [*STRIPS[: size.strips], *TILES[: size.tiles]] if pictures else []
    files = [
        Question(f"file {one.name}", one.picture(pictures[i:] + pictures[:i]))
        for i, one in enumerate(layouts)
    ]
    return Plan([Case(one, question_of(one)) for one in samples], cases, changed, files)


def drawn(samples: Sequence[Sample], count: int) -> list[Sample]:
    """Return the first of the photos of few people, in an order that depends on their names
    alone.
    """
    chosen = [
        s for s in samples if 1 <= len(s.truth["people"]) <= MOST_PEOPLE and s.name not in CROWDS
    ]
    return sorted(chosen, key=lambda s: hashlib.sha256(f"0 {s.name}".encode()).digest())[:count]


def rows_of(
    plan: Plan, other: Sequence[SimpleNamespace], this: Sequence[SimpleNamespace]
) -> list[Row]:
    """Return all figures of the answers of both builds to a plan's questions."""
    n, m = len(plan.measured), len(plan.labelled)
    both = other, this
    figures = [
        *truth_figures(plan.measured, *(one[:n] for one in both)),
        *touch_figures(plan.labelled, *(one[n : n + m] for one in both)),
        *change_figures(plan, *(one[n : n + m + len(plan.changed)] for one in both)),
        *file_figures(plan, *both),
    ]
    return [compare(figure) for figure in figures]


def truth_figures(
    cases: Sequence[Case], other: Sequence[SimpleNamespace], this: Sequence[SimpleNamespace]
) -> Iterator[Figure]:
    """Yield the figures of photos with measured truth. Joints of several views are triangulated
    from the other build's keypoints, for both.
    """
    samples = [case.sample for case in cases]
    before, after = (
        [measured_of(a, c.sample) for a, c in zip(one, cases, strict=True)] for one in (other, this)
    )
    truth = compared(samples, before)["triangulated"]
    return figures_of(*(compared(samples, one, truth) for one in (before, after)))


def touch_figures(
    cases: Sequence[Case], other: Sequence[SimpleNamespace], this: Sequence[SimpleNamespace]
) -> Iterator[Figure]:
    """Yield the figures of photos whose people have labels of touch."""
    people: list[list[dict[str, Any]]] = []
    parts: list[list[dict[str, Any]]] = []
    for answer in (other, this):
        scored = [_labelled(case, one) for case, one in zip(cases, answer, strict=True)]
        people.append([record for one, _ in scored for record in one])
        parts.append([record for _, one in scored for record in one])
    yield Figure("labelled people missed, %", paired("missed", *people), is_share=True)
    for kind in ("feet", "hands", "seat"):
        mine = [[r for r in one if r["kind"] == kind] for one in parts]
        yield touch_figure(f"labelled touch, Brier score: {kind}", *mine)


def _labelled(
    case: Case, answer: SimpleNamespace
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return people found or not, and their judged parts."""
    sample = case.sample
    truth = sample.truth["people"]
    people = measured_of(answer, sample)["people"]
    matched: Mapping[int, int] = {}
    if people:
        boxes = [person["box"] for person in people], [person["box"] for person in truth]
        matched = match_by_boxes(*boxes, MIN_IOU).predicted_of
    of = {"set": sample.set, "photo": sample.name, "group": sample.group}
    records = [
        {**of, "person": str(i), "missed": 100.0 * (i not in matched)} for i in range(len(truth))
    ]
    parts = []
    for i, j in matched.items():
        for part, label in truth[i]["parts"].items():
            touch = people[j]["parts"].get(OF_RESULTS.get(part, part))
            if label and touch is not None:
                parts.append(part_record(sample, str(i), part, touch, TOUCHES[label]))
    return records, parts


def change_figures(
    plan: Plan, other: Sequence[SimpleNamespace], this: Sequence[SimpleNamespace]
) -> Iterator[Figure]:
    """Yield how much answers change with a photo that is changed harmlessly."""
    n = len(plan.labelled)
    distance: list[Pair] = []
    usable: list[Pair] = []
    lost: list[Pair] = []
    for (i, variant, question), a, b in zip(plan.changed, other[n:], this[n:], strict=True):
        size = plan.labelled[i].question.picture.shape[1::-1]
        bases = [answer_of(one[i].people, PHOTO, *size) for one in (other, this)]
        before, after = (
            change(base, answer_of(one.people, variant, *size))
            for base, one in zip(bases, (a, b), strict=True)
        )
        ranks = same_people(*bases)
        photo = plan.labelled[i].sample.name
        if before.visible and after.visible:
            shares = [100 * (c.lost + c.new) / c.visible for c in (before, after)]
            lost.append(Pair("same photo", photo, question.name, shares[0], shares[1]))
        of = ("same photo", photo, question.name)
        moved, flipped = _of_people((before.people, after.people), ranks, of)
        distance += moved
        usable += flipped
    yield Figure("same photo, changed: distance, %, median", distance, percentile(50))
    yield Figure("same photo, changed: distance, %, 90th percentile", distance, percentile(90))
    yield Figure("same photo, changed: people with another usable mark, %", usable, is_share=True)
    yield Figure("same photo, changed: people lost or new, %", lost, is_share=True)


def _of_people(
    both: tuple[Sequence[Any], Sequence[Any]], ranks: Mapping[int, int], of: tuple[str, str, str]
) -> tuple[list[Pair], list[Pair]]:
    """Return how far each person moves in both builds, percent, and whether usable marks differ.

    Args:
        both: people of both builds, with what the change of the photo moves.
        ranks: number of a person in one build -> in the other.
        of: set, photo, and name of the question.
    """
    distance: list[Pair] = []
    usable: list[Pair] = []
    theirs = {person.person: person for person in both[1]}
    for person in both[0]:
        match = theirs.get(ranks.get(person.person, -1))
        if match is None:
            continue
        names = of[0], *(f"{word} {person.person}" for word in of[1:])
        off = [100 * abs(math.expm1(p.distance)) for p in (person, match)]
        if np.isfinite(off).all():
            distance.append(Pair(*names, *off))
        flips = [100.0 * (len(set(p.usable)) > 1) for p in (person, match)]
        usable.append(Pair(*names, *flips))
    return distance, usable


def file_figures(
    plan: Plan, other: Sequence[SimpleNamespace], this: Sequence[SimpleNamespace]
) -> Iterator[Figure]:
    """Yield how many files of several pictures are taken for one scene, and how many single photos
    for several pictures.
    """
    before, after = (list(map(says_several, one)) for one in (other, this))
    names = [question.name for question in plan.questions]
    start = len(names) - len(plan.files)
    several = [
        Pair("files", name, name, 100.0 * (not a), 100.0 * (not b))
        for name, a, b in zip(names[start:], before[start:], after[start:], strict=True)
    ]
    single = [
        Pair("photos", name, name, 100.0 * a, 100.0 * b)
        for name, a, b in zip(names[:start], before[:start], after[:start], strict=True)
    ]
    yield Figure("several pictures in a file: not detected, %", several, is_share=True)
    yield Figure("one photo taken for several pictures, %", single, is_share=True)
