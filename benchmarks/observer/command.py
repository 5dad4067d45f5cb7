"""Fit the embedded observer of people to labelled photos, and score it on other collections.

    python -m benchmarks observer DATA OUT [--questions NAME ...] [--write]

DATA/contact has ``labels.json``, ``children.json`` and ``photos``; its folders ``other``, ``third``
and ``postures`` have photos of other collections, whose labels by two readers lie beside the
benchmark: labels on which readers differ are left out. Films of DATA/truth/parkour add feet and
hands with measured forces. Tokens and keypoints of each picture are kept in OUT, so that a
second run takes no network.

Each question is scored with whole repositories left out, and on the other collections and films by
a fit to the given photos alone. The numbers are fitted to all pictures but the films apart, and
calibrated on people whose repository took no part, and written to OUT, with ``--write`` into the
plugin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from benchmarks.fits import parser_of, write_numbers
from benchmarks.truth.scores import LIMBS as LIMBS_OF_FILMS
from benchmarks.truth.sets import FILMS_OF_FITS, Sample, parkour, picture_of
from physic_embedded.person_observer import (
    NUMBERS,
    REGIONS,
    features_of_questions,
    fitted_numbers,
)
from physic_testing.metrics import match_by_boxes

from .fit import (
    APART,
    LabelledPerson,
    Question,
    figures,
    fitted,
    question_of,
)
from .labels import all_photos, with_backs
from .sample import read_seen, see, write_seen

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from .sample import Seen

FILM_FRAMES = 6
"""Frames of each film."""

_LEAST_IOU = 0.4  # of a labelled person and of a person in OUT, whose labels may have changed


def main() -> int:
    """Sample what is missing in OUT, score and fit."""
    parser = parser_of("observer", __doc__)
    parser.add_argument("data", type=Path, help="folder with contact and truth")
    parser.add_argument("out", type=Path)
    parser.add_argument("--questions", nargs="+", choices=REGIONS, default=tuple(REGIONS))
    given = parser.parse_args()
    if not (given.data / "contact" / "labels.json").is_file():
        print(f"skipped: {given.data / 'contact' / 'labels.json'} is not there")
        return 0
    photos = map(with_backs, all_photos(given.data))
    pictures = [*photos, *_frames(given.data / "truth" / "parkour")]
    people = list(_people(pictures, given.out))
    numbers = dict(fitted_numbers())
    numbers |= {name: _fitted(question_of(name, people)) for name in given.questions}
    write_numbers(numbers, NUMBERS, given.out, write=given.write)
    return 0


def _fitted(question: Question) -> NDArray[np.float32]:
    """Print the scores of a question, and return its numbers."""
    for part, scores in figures(question).items():
        print(f"{question.name:8} {part:22} {scores}", flush=True)
    return fitted(question.of(question.sets != APART))


def _frames(folder: Path) -> list[Sample]:
    """Return frames of each film whose forces are measured, spread over the film."""
    films: dict[str, list[Sample]] = {}
    for sample in parkour(folder) if folder.is_dir() else ():
        films.setdefault(sample.group, []).append(sample)
    frames = []
    for film, samples in films.items():
        name = "films" if film in FILMS_OF_FITS else APART
        for sample in samples[:FILM_FRAMES]:
            parts = {
                part: "support" if sample.truth["touches"][limb] else "none"
                for limb, part in LIMBS_OF_FILMS.items()
                if not sample.truth["uncaptured"][limb]
            }
            frames.append(replace(sample, set=name, truth={"people": [{"parts": parts}]}))
    return frames


def _people(pictures: Sequence[Sample], out: Path) -> Iterable[LabelledPerson]:
    """Return the labelled people of all pictures; what is not in OUT is looked at first."""
    for photo in pictures:
        file = out_file(out, photo)
        if not file.is_file():
            boxes = [person["box"] for person in photo.truth["people"] if "box" in person]
            picture = cv2.cvtColor(picture_of(photo), cv2.COLOR_BGR2RGB).astype(np.uint8)
            write_seen(file, see(picture, boxes))
            print(photo.set, photo.name, flush=True)
        yield from _labelled(photo, read_seen(file))


def out_file(out: Path, photo: Sample) -> Path:
    """Return the file of OUT with what was seen of a picture."""
    return out / photo.set / f"{photo.name}.npz"


def _labelled(photo: Sample, seen: Seen) -> Iterable[LabelledPerson]:
    """Return the people of a picture that were seen, with their tokens."""
    if not len(seen.boxes):
        return
    tokens_by_question = features_of_questions(seen.tokens, seen.boxes, seen.keypoints)
    boxes = [person.get("box", seen.boxes[0]) for person in photo.truth["people"]]
    same = match_by_boxes(list(seen.boxes), boxes, _LEAST_IOU).predicted_of
    for i, person in enumerate(photo.truth["people"]):
        if i in same:
            tokens = {name: values[same[i]] for name, values in tokens_by_question.items()}
            yield LabelledPerson(photo, person, tokens)
