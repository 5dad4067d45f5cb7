"""Labelled people, and what their labels answer."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.truth.contact import MIN_IOU, TOUCHES, WORLD
from benchmarks.truth.sets import Sample
from physic_core.types.observations import POSTURES, TOUCH_PARTS
from physic_core.types.skeletons import SIDES
from physic_embedded.person_observer import ANSWERS
from physic_testing.metrics import match_by_boxes

COLLECTIONS = ("other", "third", "postures")
"""Folders of DATA/contact whose photos two readers labelled apart, from the pictures alone: in
``benchmarks/truth``.
"""

MORE = ("photos", "truth/people2d", "truth/roundtable", "truth/panoptic")
"""Folders of DATA whose photos are the set "more"."""

LABELS_OF_PHOTOS = Path(__file__).parents[1] / "truth" / "labels_of_photos.json"
"""Labels of DATA/photos by two readers."""

Array = NDArray[np.float64]
Truth = Mapping[str, Any]


def repository_of(photo: Sample) -> str:
    """Return where a picture is from: its name up to two underscores, or its film."""
    return photo.name.partition("__")[0] if "__" in photo.name else photo.group


def answers(question: str, truth: Truth) -> Array:
    """Return the answers of a person's labels to a question: (sides, K) with NaN where the label
    says nothing, in the form of the tokens that answer it.
    """
    parts = truth.get("parts", {})
    if question in ANSWERS:
        paired = f"left_{question}" in TOUCH_PARTS
        names = [f"{side}_{question}" for side in SIDES] if paired else [question]
        return np.array([_touched(parts.get(name), ANSWERS[question]) for name in names])
    if question == "on_floor":
        labels = [parts.get(f"{side}_foot") for side in SIDES]
        return _column(label == "floor" if TOUCHES.get(label) else None for label in labels)
    if question == "posture":
        words = truth.get("posture")
        words = words if isinstance(words, list) else [words]
        share = np.array([[words.count(name) for name in POSTURES]], np.float64)
        return share / share.sum() if share.sum() else np.full_like(share, np.nan)
    return _column([truth.get(question)])


def _touched(label: str | None, answers: Sequence[str]) -> Array:
    """Return what a label says of each of K answers, (K,); what is none of them is nothing."""
    if label is None or label not in TOUCHES:
        return np.full(len(answers), np.nan)
    word = touched_word(label)
    word = word if word in answers else "nothing"
    return np.array([name == word for name in answers], np.float64)


def touched_word(label: str) -> str:
    """Return which of :data:`physic_core.types.TOUCHED` a label of a part says that it touches."""
    return "world" if label in WORLD else {"own": "own body", "none": "nothing"}.get(label, label)


def with_backs(photo: Sample) -> Sample:
    """Return a photo whose people have "away", whether they are seen from behind, with the people
    of whom nothing else is labelled. One reader labelled them from crops, without those in doubt.
    """
    labels = _backs().get(photo.name, [])
    labelled = photo.truth["people"]
    same = match_by_boxes(
        [one["box"] for one in labels], [one["box"] for one in labelled], MIN_IOU
    ).predicted_of
    people = [
        {**one, "away": labels[same[i]]["away"]} if i in same else one
        for i, one in enumerate(labelled)
    ]
    others = [one for i, one in enumerate(labels) if i not in same.values()]
    return replace(photo, truth={"people": [*people, *others]})


@cache
def _backs() -> Mapping[str, list[dict[str, Any]]]:
    file = Path(__file__).parents[1] / "truth" / "labels_of_backs.json"
    people_of: dict[str, list[dict[str, Any]]] = json.loads(file.read_text())
    return people_of


def _column(values: Any) -> Array:
    return np.array([[np.nan if value is None else float(value)] for value in values])


def labelled_photos(name: str, folder: Path, labels: Mapping[str, Sequence[Truth]]) -> list[Sample]:
    """Return the pictures of a folder that have labels, as a set of this name."""
    files = {file.stem: file for file in sorted(folder.iterdir())}
    return [
        Sample(name, photo, photo, files[photo], truth={"people": people})
        for photo, people in labels.items()
    ]


def given_photos(folder: Path) -> list[Sample]:
    """Return the photos of a folder with ``labels.json``, and ``children.json`` if there is one, as
    set "given".
    """
    labels = json.loads((folder / "labels.json").read_text())
    file = folder / "children.json"
    ages = json.loads(file.read_text()) if file.is_file() else {}
    for name, people in labels.items() if ages else ():
        for i, one in enumerate(people):
            unsure = i in ages["unsure"].get(name, ())
            one["child"] = None if unsure else i in ages["child"].get(name, ())
    return labelled_photos("given", folder / "photos", labels)


def collected_photos(folder: Path, name: str) -> list[Sample]:
    """Return the photos of one of :data:`COLLECTIONS` in DATA/contact, with the labels on which its
    readers agree; none if they are not there.
    """
    if not (folder / name).is_dir():
        return []
    return labelled_photos(name, folder / name / "photos", _labels_of_readers(name))


def all_photos(data: Path) -> list[Sample]:
    """Return the photos of DATA/contact and of :data:`MORE`, with the people whom two more readers
    labelled later, apart, from pictures of each person.
    """
    photos = [
        *given_photos(data / "contact"),
        *(photo for name in COLLECTIONS for photo in collected_photos(data / "contact", name)),
    ]
    later = _labels_of_readers("more")
    photos = [
        replace(one, truth={"people": [*one.truth["people"], *later.pop(one.name, ())]})
        for one in photos
    ]
    labels = json.loads(LABELS_OF_PHOTOS.read_text())
    for folder in (data / name for name in MORE if (data / name).is_dir()):
        names = {file.stem for file in folder.iterdir()} & {*labels, *later}
        people = {name: [*labels.get(name, ()), *later.get(name, ())] for name in sorted(names)}
        photos += labelled_photos("more", folder, people)
    return photos


def _labels_of_readers(name: str) -> dict[str, list[Truth]]:
    """Return the labels of a collection beside the benchmark on which both readers agree."""
    beside = Path(__file__).parents[1] / "truth"
    return agreed(
        [
            json.loads((beside / f"labels_of_{name}_{reader}.json").read_text())
            for reader in ("first", "second")
        ]
    )


def agreed(readers: Sequence[Mapping[str, Sequence[Truth]]]) -> dict[str, list[Truth]]:
    """Return the labels on which all readers agree: people whom all have, by the overlap of boxes;
    None where they differ, and all words of the posture.
    """
    first, *others = readers
    people_of: dict[str, list[Truth]] = {}
    for name, people in first.items():
        same: list[Truth] = [dict(one) for one in people]
        for other in others:
            theirs = other.get(name, ())
            of = match_by_boxes(
                [one["box"] for one in theirs], [one["box"] for one in same], MIN_IOU
            ).predicted_of
            same = [_both(one, theirs[of[i]]) for i, one in enumerate(same) if i in of]
        people_of[name] = same
    return people_of


def _both(one: Truth, other: Truth) -> Truth:
    parts = {
        part: label if _same(label, other["parts"].get(part)) else None
        for part, label in one["parts"].items()
    }
    words = [*_words(one), *_words(other)]
    child = one.get("child") if one.get("child") == other.get("child") else None
    return {"box": one["box"], "posture": words, "parts": parts, "child": child}


def _words(one: Truth) -> list[str]:
    word = one.get("posture")
    return word if isinstance(word, list) else [word] if word else []


def _same(a: str | None, b: str | None) -> bool:
    """Return whether two labels say the same: what is touched, and whether it is the floor."""
    return (a and touched_word(a), a == "floor") == (b and touched_word(b), b == "floor")
