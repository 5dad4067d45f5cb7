"""Fit the touch of body parts by their distance on labelled photos.

    python -m benchmarks contact_on_photos sample DATA OUT
    python -m benchmarks contact_on_photos fit DATA OUT [--write]

``sample`` runs the embedded preset on the labelled photos of DATA/contact, of its folders of other
collections, and of DATA/photos, and keeps the distances of each person in a file of OUT; an
interrupted run continues. OUT may lack photos, and those in it may be chosen by their labels: the
constants are for the shares of touching parts among all labelled people.

``fit`` prints the scores of pictures of DATA/contact, each by a fit to the others, and of each
other collection by a fit to DATA/contact alone, and with ``--write`` writes
``physic_core/engine/ground/touch.json``, fitted on all, and the shares of touching parts, which
parts have that nothing shows. A kind of part whose model is worse there than a constant has none.

The labels of DATA/photos and of the collections lie beside the benchmark: two readers labelled them
apart, from the pictures alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from physic_core.types import TOUCHED
from physic_testing.metrics import match_by_boxes

from .fits import FOLDS, fold_of, name_in_sets, parser_of, write_record
from .observer.labels import COLLECTIONS, all_photos, touched_word
from .observer.regression import Examples, fit_logistic
from .truth.contact import KINDS, MIN_IOU, OF_RESULTS, TOUCHES
from .truth.measures import probability_scores
from .truth.sets import Sample, picture_of

if TYPE_CHECKING:
    from physic_core import Pipeline
    from physic_core.body.model import BodyModel
    from physic_core.engine.state import Estimates

Array = NDArray[np.float64]

TOUCH = Path(__file__).parents[1] / "physic_core" / "engine" / "ground" / "touch.json"
_LEAST_COUNT = 0.5  # of each answer: none has a rate of 0
EXERCISES = "postures"
"""Collection that was chosen by what people do: it takes no part in the fit."""
RIDGE = 1.0
"""Weight of half the squared coefficients of standardised features."""

CONTACT = "contact"
"""Set of the photos of DATA/contact and DATA/photos, and of the films."""

PARTS = ("foot", "hand", "seat")
"""Kinds of parts that are fitted."""


@dataclass(frozen=True)
class Case:
    """A judged part of one person.

    Attributes:
        picture: photo, which is left out at once.
        kind: of the part.
        distance: from the nearest surface, in standard deviations.
        touches: whether it touches the world.
        set: of the picture: :data:`CONTACT`, or a collection.
    """

    picture: str
    kind: str
    distance: float
    touches: bool
    set: str = CONTACT


Likely: TypeAlias = tuple[Case, float]
"""A case with its fitted probability."""


def main() -> int:
    """Sample or fit."""
    parser = parser_of("contact_on_photos", __doc__)
    parser.add_argument("step", choices=("sample", "fit"))
    parser.add_argument("data", type=Path, help="folder with contact and photos")
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    samples = samples_of(given.data)
    if given.step == "fit":
        record = json.loads(TOUCH.read_text()) | fitted(cases_of(samples, given.out), samples)
        write_record(record, TOUCH, write=given.write)
        return 0
    from physic_core import Pipeline, load_config

    with Pipeline(load_config(preset="embedded")) as pipeline:
        for sample in samples:
            keep_distances(sample, pipeline, given.out)
    return 0


def samples_of(data: Path) -> list[Sample]:
    """Return the labelled photos of all collections."""
    return [
        replace(photo, set=CONTACT) if photo.set in ("given", "more") else photo
        for photo in all_photos(data)
    ]


def file_of(sample: Sample, out: Path) -> Path:
    """Return the file of OUT with the distances of a sample."""
    return out / f"{sample.set}-{sample.name}.json"


def keep_distances(sample: Sample, pipeline: Pipeline, out: Path) -> None:
    """Run the pipeline on a sample and write the distances of its people's parts."""
    file = file_of(sample, out)
    if file.exists():
        return
    import cv2

    from physic_core.engine.contact import probability
    from physic_core.errors import PhysicError

    estimates: list[Estimates] = []
    distances: list[Any] = []
    measure = probability.part_distances

    def complete(estimate: Estimates) -> Estimates:
        estimates.append(estimate)
        return estimate

    def part_distances(model: BodyModel, at: Any) -> Any:
        distances.append(measure(model, at))
        return distances[-1]

    picture = picture_of(sample)
    with patch.object(probability, "part_distances", part_distances):
        try:
            pipeline(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), complete=complete)
        except PhysicError as error:
            print(f"{sample.set} {sample.name}: {error}", file=sys.stderr)
    people: list[dict[str, Any]] = []
    for parts, estimate in zip(distances[:1], estimates, strict=False):
        size = np.array([picture.shape[k] / estimate.image.shape[k] for k in (1, 0)])
        for i, box in enumerate(np.asarray(estimate.photo.people.boxes, np.float64)):
            place = (box * np.tile(size, 2)).tolist()
            distances_of_person = {part: values.tolist()[i] for part, values in parts.items()}
            people.append({"box": place, "parts": distances_of_person})
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(people))
    print(sample.set, sample.name, len(people), file=sys.stderr, flush=True)


def cases_of(samples: Sequence[Sample], out: Path) -> list[Case]:
    """Return the judged parts of the people of OUT, without exercises."""
    cases: list[Case] = []
    for sample in samples:
        file = file_of(sample, out)
        if sample.set == EXERCISES or not file.exists():
            continue
        people, truth = json.loads(file.read_text()), sample.truth["people"]
        boxes = ([one["box"] for one in some] for some in (people, truth))
        for i, j in match_by_boxes(*boxes, MIN_IOU).predicted_of.items():
            for part, label in truth[i]["parts"].items():
                distance = people[j]["parts"].get(OF_RESULTS.get(part, part))
                kind = part.rpartition("_")[2]
                if label and distance is not None and kind in PARTS:
                    picture = name_in_sets(sample.name)
                    cases.append(Case(picture, kind, distance, TOUCHES[label], sample.set))
    return cases


def rates_of(samples: Sequence[Sample]) -> dict[str, Any]:
    """Return kind of part -> what it touches -> share, among all labelled people, and the share of
    feet on the floor among those that touch the world; of feet, hands and seats without exercises,
    which were chosen by what people do.
    """
    counts = {kind: dict.fromkeys(TOUCHED, _LEAST_COUNT) for kind in KINDS}
    feet = []
    for sample in samples:
        for person in sample.truth["people"]:
            for part, label in person["parts"].items():
                kind = part.rpartition("_")[2]
                chosen = sample.set == EXERCISES and kind in PARTS
                if label is None or kind not in counts or chosen:
                    continue
                counts[kind][touched_word(label)] += 1
                if kind == "foot" and TOUCHES.get(label):
                    feet.append(label == "floor")
    rates = {
        kind: {word: count / sum(of.values()) for word, count in of.items()}
        for kind, of in counts.items()
    }
    return {"rates": rates, "floor rate": float(np.mean(feet))}


def fit_of(cases: Sequence[Case], share: float) -> Array:
    """Return slope and constant of the log odds of parts of one kind, by maximum likelihood with a
    ridge, for the share of touching parts that all labelled people have.
    """
    distances = np.array([[case.distance] for case in cases], np.float64)
    touches = np.array([[case.touches] for case in cases], np.float64)
    numbers = fit_logistic(Examples(distances, touches, np.ones(len(cases)), ()), RIDGE)[0]
    numbers[1] += logit(share) - logit(touches.mean())
    return numbers


def fitted(cases: Sequence[Case], samples: Sequence[Sample]) -> dict[str, Any]:
    """Return the fitted file: the scores of the collections, models that are fitted to all cases,
    and the rates of all labelled people.
    """
    statistics = rates_of(samples)
    shares = {kind: of["world"] for kind, of in statistics["rates"].items()}
    errors, parts, pictures = {}, {}, {}
    for kind in PARTS:
        of_kind = [case for case in cases if case.kind == kind]
        labelled = [case for case in of_kind if case.set == CONTACT]
        likely = {"contact, pictures left out": left_out_chances(labelled, shares[kind])}
        numbers = fit_of(labelled, shares[kind])
        for name in COLLECTIONS:
            rows = [(case, chance(case, numbers)) for case in of_kind if case.set == name]
            likely[f"{name}, by contact"] = rows
        errors[kind] = {name: words for name, rows in likely.items() if (words := described(rows))}
        score = scores_of([row for rows in likely.values() for row in rows])
        if score["brier"] < score["constant"]:
            slope, constant = fit_of(of_kind, shares[kind]).round(3).tolist()
            parts[kind] = {"constant": constant, "distance": slope}
        pictures[kind] = f"{len({case.picture for case in of_kind})} photos labelled by two readers"
    others = [share for kind, share in shares.items() if kind not in PARTS]
    return {
        "fitted on": pictures,
        "error on pictures left out": errors,
        "rates": {
            kind: {word: round(share, 4) for word, share in of.items()}
            for kind, of in statistics["rates"].items()
        },
        "floor rate": round(statistics["floor rate"], 3),
        "parts": parts,
        "rate of others": round(float(np.mean(others)), 3),
    }


def left_out_chances(cases: Sequence[Case], share: float) -> list[Likely]:
    """Return parts of one kind, each with its probability by a fit without a tenth of the
    pictures.
    """
    rows: list[Likely] = []
    for fold in range(FOLDS):
        numbers = fit_of([case for case in cases if fold_of(case.picture) != fold], share)
        left_out = (case for case in cases if fold_of(case.picture) == fold)
        rows += [(case, chance(case, numbers)) for case in left_out]
    return rows


def chance(case: Case, numbers: Array) -> float:
    """Return the probability that the part of a case touches."""
    return float(expit(numbers[0] * case.distance + numbers[1]))


def scores_of(rows: Sequence[Likely]) -> dict[str, float]:
    """Return the scores of probabilities of parts left out."""
    return probability_scores([p for _, p in rows], [case.touches for case, _ in rows])


def described(rows: Sequence[Likely]) -> str:
    """Return scores in words; "" unless some parts touch and some do not."""
    touch = sum(case.touches for case, _ in rows)
    if touch in (0, len(rows)):
        return ""
    score = scores_of(rows)
    return (
        f"{len(rows)} judged, {touch} touch: AUC {score['auc']:.3f}, Brier "
        f"{score['brier']:.3f} (constant {score['constant']:.3f}), balanced "
        f"{score['balanced']:.2f}, recall {score['recall']:.2f}, false "
        f"{1 - score['specificity']:.2f}, calibration error {score['calibration']:.3f}"
    )
