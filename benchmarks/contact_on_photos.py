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
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from physic_core.types import TOUCHED
from physic_testing.metrics import match_by_boxes

from .fits import FOLDS, fold_of, name_in_sets, parser_of, write_record
from .observer.labels import COLLECTIONS, all_photos, touched_word
from .observer.regression import Examples, fit_logistic
from .truth.contact import KINDS, MIN_IOU, OF_RESULTS, TOUCHES
from .truth.measures import probability_scores
from .truth.sets import Sample, picture_of

if TYPE_CHECKING:
    from torch import Tensor

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


def main() -> int:
    """Sample or fit."""
    parser = parser_of("contact_on_photos", __doc__)
    parser.add_argument("step", choices=("sample", "fit"))
    parser.add_argument("data", type=Path, help="folder with contact and photos")
    parser.add_argument("out", type=Path)
    parser.add_argument("--kinds", nargs="+", choices=PARTS, default=tuple(PARTS))
    given = parser.parse_args()
    samples = samples_of(given.data)
    if given.step == "sample":
        from physic_core import Pipeline, load_config

        with Pipeline(load_config(preset="embedded")) as pipeline:
            for sample in samples:
                keep_distances(sample, pipeline, given.out)
        return 0
    cases = cases_of(samples, given.out)
    fit_all(cases, given.kinds, samples, write=given.write)
    return 0


def samples_of(data: Path) -> list[Sample]:
    """Return the labelled photos of all collections."""
    return [
        replace(photo, set=CONTACT) if photo.set in ("given", "more") else photo
        for photo in all_photos(data)
    ]


def keep_distances(sample: Sample, pipeline: Pipeline, out: Path) -> None:
    """Run the pipeline on a sample and write the distances of its people's parts."""
    file = out / f"{sample.set}-{sample.name}.json"
    if file.exists():
        return
    import cv2

    from physic_core.engine.contact import probability
    from physic_core.errors import PhysicError

    estimates: list[Estimates] = []
    distances: list[dict[str, Tensor]] = []

    def complete(found: Estimates) -> Estimates:
        estimates.append(found)
        return found

    picture = picture_of(sample)
    with recorded(probability, "part_distances", distances):
        try:
            pipeline(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), complete=complete)
        except PhysicError as error:
            print(f"{sample.set} {sample.name}: {error}", file=sys.stderr)
    people: list[dict[str, Any]] = []
    for parts, seen in zip(distances[:1], estimates, strict=False):
        size = np.array([picture.shape[k] / seen.image.shape[k] for k in (1, 0)])
        for i, box in enumerate(np.asarray(seen.photo.people.boxes, np.float64)):
            place = (box * np.tile(size, 2)).tolist()
            own = {part: values.tolist()[i] for part, values in parts.items()}
            people.append({"box": place, "parts": own})
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(people))
    print(sample.set, sample.name, len(people), file=sys.stderr, flush=True)


@contextmanager
def recorded(module: ModuleType, name: str, calls: list[Any]) -> Iterator[None]:
    """Keep the result of each call of a module's function meanwhile."""
    function = getattr(module, name)

    def record(model: BodyModel, at: Any) -> Any:
        found = function(model, at)
        calls.append(found)
        return found

    with patch.object(module, name, record):
        yield


def _logit(probability: float) -> float:
    return float(np.log(probability) - np.log1p(-probability))


def cases_of(samples: Sequence[Sample], out: Path) -> list[Case]:
    """Return the judged parts of the samples in OUT."""
    cases: list[Case] = []
    for sample in samples:
        file = out / f"{sample.set}-{sample.name}.json"
        people = json.loads(file.read_text()) if file.exists() else []
        for found, labels in labels_of(sample, people):
            cases += [
                Case(name_in_sets(sample.name), kind, distance, touches, sample.set)
                for kind, distance, touches in placed_parts(found, labels)
                if sample.set != EXERCISES
            ]
    return cases


Judged: TypeAlias = tuple[str, float, bool]
"""Kind, distance, and whether it touches."""


def placed_parts(one: Mapping[str, Any], labels: Mapping[str, str]) -> Iterator[Judged]:
    """Yield the labelled parts of a person by their distance."""
    for part, label in labels.items():
        distance = one["parts"].get(OF_RESULTS.get(part, part))
        kind = part.rpartition("_")[2]
        if distance is not None and kind in PARTS:
            yield kind, distance, TOUCHES[label]


def labels_of(
    sample: Sample, people: Sequence[Mapping[str, Any]]
) -> list[tuple[Mapping[str, Any], dict[str, str]]]:
    """Return the found people of a sample whose parts were judged, with part -> label."""
    truth = sample.truth["people"]
    if not people:
        return []
    matched = match_by_boxes(
        [person["box"] for person in people], [one["box"] for one in truth], MIN_IOU
    ).predicted_of
    return [
        (people[j], {part: label for part, label in truth[i]["parts"].items() if label})
        for i, j in matched.items()
    ]


def logistic(features: Array, touches: Array) -> Array:
    """Return constant and coefficients of log odds, by maximum likelihood with a ridge on
    standardised columns.
    """
    cases = Examples(features, touches[:, None], np.ones(len(features)), ())
    return np.roll(fit_logistic(cases, RIDGE)[0], 1)


def table_of(cases: Sequence[Case], kind: str) -> tuple[Array, Array]:
    """Return distances (n, 1) and whether the parts touch, of the cases of one kind."""
    own = [case for case in cases if case.kind == kind]
    distances = np.array([[case.distance] for case in own], np.float64)
    return distances, np.array([case.touches for case in own], np.float64)


def labelled_rates(samples: Sequence[Sample]) -> dict[str, dict[str, float]]:
    """Return kind of part -> what it touches -> share, among all labelled people; of feet, hands
    and seats without exercises, which were chosen by what people do.
    """
    counts = {kind: dict.fromkeys(TOUCHED, _LEAST_COUNT) for kind in KINDS}
    for sample in samples:
        chosen = PARTS if sample.set == EXERCISES else ()
        for person in sample.truth["people"]:
            for part, label in person["parts"].items():
                kind = part.rpartition("_")[2]
                if label is not None and kind in counts and kind not in chosen:
                    counts[kind][touched_word(label)] += 1
    return {
        kind: {word: count / sum(of.values()) for word, count in of.items()}
        for kind, of in counts.items()
    }


def labelled_floor_rate(samples: Sequence[Sample]) -> float:
    """Return the share of feet that touch the world which are on the floor, of the same people."""
    return float(
        np.mean(
            [
                label == "floor"
                for sample in samples
                if sample.set != EXERCISES
                for person in sample.truth["people"]
                for part, label in person["parts"].items()
                if part.endswith("_foot") and TOUCHES.get(label)
            ]
        )
    )


def fit_of(cases: Sequence[Case], kind: str, shares: Mapping[str, float]) -> Array:
    """Return constant and coefficient of a kind of part, for the share of touching parts that
    all labelled people have.
    """
    distances, touches = table_of(cases, kind)
    found = logistic(distances, touches)
    found[0] += _logit(shares[kind]) - _logit(float(touches.mean()))
    return found


def fit_all(
    cases: Sequence[Case], kinds: Sequence[str], samples: Sequence[Sample], *, write: bool
) -> None:
    """Score the collections, then fit these kinds of part on all cases; and the rates of the
    labelled people of the samples.
    """
    record = json.loads(TOUCH.read_text())
    rates = labelled_rates(samples)
    shares = {kind: rates[kind]["world"] for kind in PARTS}
    scores = record["error on pictures left out"]
    weights = record["parts"]
    for kind in kinds:
        given = [case for case in cases if case.set == CONTACT]
        w = fit_of(given, kind, shares)
        likely = {"contact, pictures left out": left_out_chances(given, kind, shares)}
        for name in COLLECTIONS:
            own = [case for case in cases if case.set == name and case.kind == kind]
            likely[f"{name}, by contact"] = [(case, chance(case, w)) for case in own]
        scores[kind] = {name: words for name, rows in likely.items() if (words := described(rows))}
        weights.pop(kind, None)
        if is_better_than_constant([one for rows in likely.values() for one in rows]):
            w = fit_of(cases, kind, shares)
            weights[kind] = dict(zip(("constant", "distance"), w.round(3).tolist(), strict=True))
    record["error on pictures left out"] = {kind: scores[kind] for kind in PARTS}
    record["rates"] = {
        kind: {word: round(share, 4) for word, share in of.items()} for kind, of in rates.items()
    }
    others = [of["world"] for kind, of in rates.items() if kind not in PARTS]
    record["rate of others"] = round(float(np.mean(others)), 3)
    record["floor rate"] = round(labelled_floor_rate(samples), 3)
    record["parts"] = {kind: weights[kind] for kind in PARTS if kind in weights}
    pictures = {kind: len({c.picture for c in cases if c.kind == kind}) for kind in kinds}
    record["fitted on"] |= {
        kind: f"{count} photos labelled by two readers" for kind, count in pictures.items()
    }
    write_record(record, TOUCH, write=write)


def left_out_chances(
    cases: Sequence[Case], kind: str, shares: Mapping[str, float]
) -> list[tuple[Case, float]]:
    """Return the photos' parts of one kind, each with its probability by a fit without a tenth of
    the pictures.
    """
    found = []
    for fold in range(FOLDS):
        w = fit_of([case for case in cases if fold_of(case.picture) != fold], kind, shares)
        own = (c for c in cases if c.kind == kind and fold_of(c.picture) == fold)
        found += [(case, chance(case, w)) for case in own]
    return found


def chance(case: Case, weights: Array) -> float:
    """Return the probability that the part of a case touches."""
    return float(1 / (1 + np.exp(-(weights[0] + weights[1] * case.distance))))


def is_better_than_constant(rows: Sequence[tuple[Case, float]]) -> bool:
    """Return whether probabilities of parts left out have a lower Brier score than their mean."""
    score = probability_scores([p for _, p in rows], [case.touches for case, _ in rows])
    return score["brier"] < score["constant"]


def described(rows: Sequence[tuple[Case, float]]) -> str:
    """Return scores in words; "" unless some parts touch and some do not."""
    touches = np.array([case.touches for case, _ in rows], bool)
    if touches.all() or not touches.any():
        return ""
    likely = np.array([p for _, p in rows])
    score = probability_scores(likely.tolist(), touches.tolist())
    return (
        f"{len(rows)} judged, {touches.sum()} touch: AUC {score['auc']:.3f}, Brier "
        f"{score['brier']:.3f} (constant {score['constant']:.3f}), balanced "
        f"{score['balanced']:.2f}, recall {score['recall']:.2f}, false "
        f"{1 - score['specificity']:.2f}, calibration error {score['calibration']:.3f}"
    )
