"""Fit the touch of body parts on labelled photos and films with measured forces.

    python -m benchmarks contact_on_photos sample DATA OUT [--films N]
    python -m benchmarks contact_on_photos fit DATA OUT --observed FILE [--write]

``sample`` runs the embedded preset on the labelled photos of DATA/contact, of its folders of other
collections, and of DATA/photos, and on N frames of each of the films of fits, and keeps the
features of each person in a file of OUT; an interrupted run continues. OUT may lack photos, and
those in it may be chosen by their labels: the constants are for the shares of touching parts among
all labelled people. FILE is the ``left_out.json`` of ``benchmarks observer``: what fits of the
observer to other pictures say, in place of what the shipped numbers say, which were fitted to these
pictures.

``fit`` prints the scores of pictures of DATA/contact, each by a fit to the others, and of each
other collection by a fit to DATA/contact alone, and with ``--write`` writes
``physic_core/engine/ground/touch.json``, fitted on all.

A part that nothing shows has a base rate. It is made by cutting people in sight between shoulders
and hips, hips and knees, and knees and ankles: the parts below are as labelled.

Contact with other people and the own body is of kind "skin", fitted to the labelled hands, feet,
forearms and lower legs.

The labels of DATA/photos and of the collections lie beside the benchmark: two readers labelled them
apart, from the pictures alone. A frame of a film counts half, since the frames of a film are not
independent.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.engine.contact.distances import SEARCH_RADIUS_M
from physic_core.engine.contact.parts import contact_regions
from physic_core.engine.contact.probability import RATED
from physic_core.engine.ground.touch import (
    CARRIES,
    DISTANCE,
    HAND,
    INSIDE,
    LIES,
    OBSERVED,
    OUTSIDE,
    OWN_BODY,
    SKIN,
)
from physic_core.types.skeletons import SIDES
from physic_testing.metrics import match_by_boxes

from .observer.labels import COLLECTIONS, collected_photos
from .truth.contact import MIN_IOU, OF_RESULTS, TOUCHES
from .truth.measures import probability_scores
from .truth.scores import LIMBS
from .truth.sets import FILMS_OF_FITS, Sample, labelled_photos, parkour, picture_of

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core import Pipeline
    from physic_core.body.model import BodyModel
    from physic_core.engine.contact.distances import Distances
    from physic_core.engine.contact.probability import NearScene, NearSkin
    from physic_core.engine.state import Estimates, State

Array = NDArray[np.float64]

TOUCH = Path(__file__).parents[1] / "physic_core" / "engine" / "ground" / "touch.json"
LABELS_OF_PHOTOS = Path(__file__).parent / "truth" / "labels_of_photos.json"
FRAME_WEIGHT = 0.5
EXERCISES = "postures"
"""Collection that was chosen by what people do: it takes part in the fit of "other" parts alone."""
RIDGE = 1.0
"""Weight of half the squared coefficients of standardised features."""

HALVES = ("development", "held")

CONTACT = "contact"
"""Set of the photos of DATA/contact and DATA/photos, and of the films."""

PARTS: dict[str, tuple[str, ...]] = {
    "foot": (OBSERVED,),
    "hand": (OBSERVED,),
    "seat": (OBSERVED,),
    "object": (OBSERVED,),
    "foot by distance": (DISTANCE,),
    "hand by distance": (DISTANCE,),
    "seat by distance": (DISTANCE,),
    "other": (LIES, CARRIES),
    "unseen foot": (),
    "unseen hand": (),
    "unseen seat": (),
    SKIN: (OUTSIDE, INSIDE, HAND, OWN_BODY),
}
"""Kind of part -> its features, of ``part_features`` in ``engine/contact/probability.py``."""

LABELLED_ON_SKIN = tuple(
    f"{side}_{limb}" for side in SIDES for limb in ("hand", "foot", "knee", "forearm")
)
"""Parts whose labels say whether they touch another person or the own body."""

NO_SKIN = {OUTSIDE: math.log1p(SEARCH_RADIUS_M / 0.01), INSIDE: 0.0}
"""Features of a part that has no skin near it."""

SkinFeatures: TypeAlias = tuple[str, str, dict[str, float]]

CUTS = (("knee", "ankle"), ("hip", "knee"), ("shoulder", "hip"))
"""Joints above and below each cut."""

ENDS = {"foot": "ankle", "hand": "wrist", "seat": "knee"}
"""Label of a part without its side -> the joint below the cut, without which nothing shows the
part.
"""


@dataclass(frozen=True)
class Case:
    """A judged part of one person.

    Attributes:
        picture: photo or film, which is left out at once.
        kind: of the part.
        features: by name.
        touches: whether it touches the world.
        weight: of the case.
        set: of the picture: :data:`CONTACT`, or a collection.
    """

    picture: str
    kind: str
    features: Mapping[str, float]
    touches: bool
    weight: float = 1.0
    set: str = CONTACT


def main() -> int:
    """Sample or fit."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks contact_on_photos",
        description=(__doc__ or "").partition("\n")[0],
    )
    parser.add_argument("step", choices=("sample", "fit"))
    parser.add_argument("data", type=Path, help="folder with contact, photos and truth")
    parser.add_argument("out", type=Path)
    parser.add_argument("--films", type=int, default=6, metavar="N", help="frames of each film")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="configuration, in place of the preset embedded"
    )
    parser.add_argument("--observed", type=Path, metavar="FILE", help="left_out.json of observer")
    parser.add_argument("--kinds", nargs="+", choices=PARTS, default=tuple(PARTS))
    parser.add_argument("--write", action="store_true", help="write the fitted file")
    given = parser.parse_args()
    samples = samples_of(given.data, given.films)
    if given.step == "sample":
        from physic_core import Pipeline, load_config

        with Pipeline(load_config(given.config, preset="embedded")) as pipeline:
            for sample in samples:
                keep_features(sample, pipeline, given.out)
        return 0
    if given.observed is None:
        parser.error("fit needs --observed: left_out.json, which benchmarks observer writes")
    left_out_of = json.loads(given.observed.read_text())
    cases = cases_of(samples, given.out, left_out_of)
    fit_all(cases, given.kinds, labelled_shares(samples), write=given.write)
    return 0


def samples_of(data: Path, frames: int) -> list[Sample]:
    """Return the labelled photos of all collections and the first N frames of each film of fits."""
    photos = labelled_photos(data / "contact")
    files = {file.stem: file for file in (data / "photos").iterdir()}
    more = json.loads(LABELS_OF_PHOTOS.read_text())
    photos += [
        Sample(CONTACT, name, name, files[name], truth={"people": people})
        for name, people in more.items()
    ]
    for collection in COLLECTIONS:
        for photo in collected_photos(data / "contact", collection):
            source = next((data / "contact" / collection / "photos").glob(f"{photo.name}.*"))
            truth = {"people": photo.people}
            photos.append(Sample(collection, photo.name, photo.name, source, truth=truth))
    films: dict[str, list[Sample]] = {}
    for sample in parkour(data / "truth" / "parkour"):
        if sample.group in FILMS_OF_FITS:
            films.setdefault(sample.group, []).append(sample)
    return [*photos, *(frame for own in films.values() for frame in own[:frames])]


def keep_features(sample: Sample, pipeline: Pipeline, out: Path) -> None:
    """Run the pipeline on a sample and write the features of its people."""
    file = out / f"{sample.set}-{sample.name}.json"
    if file.exists():
        return
    import cv2

    from physic_core.engine.contact import probability
    from physic_core.errors import PhysicError

    kept: list[dict[str, dict[str, list[float]]]] = []
    estimates: list[Any] = []
    skin: list[list[SkinFeatures]] = []
    features_of = probability.part_features
    skin_of = probability.near_skin

    def recorded(state: State, at: NearScene) -> dict[str, dict[str, Tensor]]:
        features = features_of(state, at)
        kept.append(
            {part: {key: v.tolist() for key, v in own.items()} for part, own in features.items()}
        )
        return features

    def complete(found: Estimates) -> Estimates:
        estimates.append(found)
        return found

    def recorded_skin(state: State, near: Distances) -> tuple[NearSkin, NearSkin]:
        found = skin_of(state, near)
        skin.extend(skin_features(state.model, found))
        return found

    with (
        patch.object(probability, "part_features", recorded),
        patch.object(probability, "near_skin", recorded_skin),
    ):
        try:
            pipeline(cv2.cvtColor(picture_of(sample), cv2.COLOR_BGR2RGB), complete=complete)
        except PhysicError as error:
            print(f"{sample.set} {sample.name}: {error}", file=sys.stderr)
    people: list[dict[str, Any]] = []
    height, width = picture_of(sample).shape[:2]
    joints = {
        f"{side}_{one}"
        for side in ("left", "right")
        for one in ("shoulder", "hip", "knee", "ankle", "wrist")
    }
    for e in estimates if kept else ():
        rows = {
            name: j for j, name in enumerate(e.photo.keypoints.joint_set.names) if name in joints
        }
        factor = width / e.image.shape[1], height / e.image.shape[0]
        for i, box in enumerate(np.asarray(e.photo.people.boxes, np.float64)):
            people.append(
                {
                    "box": (box * np.tile(factor, 2)).tolist(),
                    "parts": {
                        part: {k: v[i] for k, v in each.items()} for part, each in kept[0].items()
                    },
                    "y": {
                        name: float(e.photo.keypoints.points[i, j, 1] * factor[1])
                        for name, j in rows.items()
                    },
                    "skin": skin[i] if skin else [],
                }
            )
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(people))
    print(sample.set, sample.name, len(people), file=sys.stderr, flush=True)


def skin_features(model: BodyModel, near: Sequence[NearSkin]) -> list[list[SkinFeatures]]:
    """Return for each person part, kind of partner, and features of the pair of vertices that is
    nearest, of the parts whose partner is labelled.
    """
    names, region = contact_regions(model)
    people: list[list[SkinFeatures]] = [[] for _ in near[0].gap]
    for kind, at in zip(("person", "own"), near, strict=True):
        for part in sorted({OF_RESULTS.get(part, part) for part in LABELLED_ON_SKIN}):
            own = torch.where(region == names.index(part), at.gap, torch.inf)
            for i, nearest in enumerate(own.argmin(1).tolist()):
                if torch.isfinite(own[i, nearest]):
                    features = {key: float(v[i, nearest]) for key, v in at.features.items()}
                else:
                    features = {**NO_SKIN, HAND: float("hand" in part)}
                people[i].append((part, kind, {**features, OWN_BODY: float(kind == "own")}))
    return people


def _logit(probability: float) -> float:
    return float(np.log(probability) - np.log1p(-probability))


def cases_of(
    samples: Sequence[Sample], out: Path, left_out_of: Mapping[str, Sequence[Mapping[str, Any]]]
) -> list[Case]:
    """Return the judged parts of the samples in OUT; picture -> rows of box and log odds that a fit
    of the observer to others gives.
    """
    cases: list[Case] = []
    for sample in samples:
        file = out / f"{sample.set}-{sample.name}.json"
        people = json.loads(file.read_text()) if file.exists() else []
        said = [
            {"box": row["box"] or (people[0]["box"] if people else [0, 0, 1, 1]), **row["parts"]}
            for row in left_out_of.get(sample.name, ())
        ]
        found = [
            *(case for one in labels_of(sample, said) for case in observed_parts(*one)),
            *(case for one in labels_of(sample, people) for case in placed_parts(*one)),
            *skin_cases(sample, people),
        ]
        weight = 1.0 if sample.frame is None else FRAME_WEIGHT
        cases += [
            Case(picture_name(sample), kind, features, touches, weight, sample.set)
            for kind, features, touches in found
            if sample.set != EXERCISES or kind == "other"
        ]
    return cases


Judged: TypeAlias = tuple[str, Mapping[str, float], bool]
"""Kind, features, and whether it touches."""


def observed_parts(said: Mapping[str, Any], labels: Mapping[str, str]) -> Iterator[Judged]:
    """Yield the labelled parts of a person, by what fits of the observer to other pictures say."""
    for part, label in labels.items():
        kind = part.rpartition("_")[2]
        if kind in RATED and part in said:
            yield kind, {OBSERVED: said[part]}, TOUCHES[label]
        if kind == "hand" and part in said:
            held = said[part.replace("hand", "object")]
            yield "object", {OBSERVED: held}, label == "object"


def placed_parts(one: Mapping[str, Any], labels: Mapping[str, str]) -> Iterator[Judged]:
    """Yield the labelled parts of a person by their distance, and those that cuts remove."""
    for part, label in labels.items():
        features = one["parts"].get(OF_RESULTS.get(part, part))
        kind = part.rpartition("_")[2]
        if features is not None:
            yield f"{kind} by distance" if kind in RATED else "other", features, TOUCHES[label]
    touches = {part: TOUCHES[label] for part, label in labels.items()}
    for row in cut_rows(one["y"]).values():
        for part, touching in removed_parts(one["y"], touches, row).items():
            yield f"unseen {part.rpartition('_')[2]}", {}, touching


def skin_cases(sample: Sample, people: Sequence[Mapping[str, Any]]) -> list[Judged]:
    """Return whether the labelled parts of the found people of a photo touch another person, if one
    was found, and the own body.
    """
    truth = sample.truth.get("people", ())
    if not people or not truth:
        return []
    matched = match_by_boxes(
        [one["box"] for one in people], [one["box"] for one in truth], MIN_IOU
    ).predicted_of
    cases = []
    for i, j in matched.items():
        labels = {OF_RESULTS.get(part, part): label for part, label in truth[i]["parts"].items()}
        for part, partner, features in people[j]["skin"]:
            if labels.get(part) is not None and (partner == "own" or len(people) > 1):
                touches = labels[part] == partner
                cases.append((SKIN, features, touches))
    return cases


def cut_rows(y: Mapping[str, float]) -> dict[str, float]:
    """Return joint above the cut -> row between these joints and those below, px, where they are in
    this order.
    """
    found = {}
    for above, below in CUTS if y else ():
        upper, lower = (
            [y[f"{side}_{joint}"] for side in ("left", "right")] for joint in (above, below)
        )
        if max(upper) < min(lower):
            found[above] = (max(upper) + min(lower)) / 2
    return found


def removed_parts(
    y: Mapping[str, float], judged: Mapping[str, bool], row: float
) -> dict[str, bool]:
    """Return the judged feet, hands and seat whose ends are below a row: part -> whether it touches
    the world.
    """
    found = {}
    for part, touches in judged.items():
        side, _, kind = part.rpartition("_")
        ends = [0.0]
        if kind in ENDS:
            sides = [side] if side else ["left", "right"]
            ends = [y[f"{one}_{ENDS[kind]}"] for one in sides]
        if min(ends) > row:
            found[part] = touches
    return found


def picture_name(sample: Sample) -> str:
    """Return a name that a picture has in all sets: the number that its source gave it, else the
    end of its name.
    """
    return sample.group if sample.frame is not None else name_in_sets(sample.name)


def name_in_sets(photo: str) -> str:
    """Return :func:`picture_name` of a photo of this name."""
    numbers = re.findall(r"\d{6,}", photo)
    return numbers[-1] if numbers else re.sub("^tfjs(-models_)?_", "", photo)


def half_of(picture: str) -> str:
    """Return the half of a photo with this :func:`picture_name`."""
    return HALVES[digest(picture) % 2]


def digest(text: str) -> int:
    """Return a number below 256 that depends on a text alone."""
    return hashlib.sha256(text.encode()).digest()[0]


def labels_of(
    sample: Sample, people: Sequence[Mapping[str, Any]]
) -> list[tuple[Mapping[str, Any], dict[str, str]]]:
    """Return the found people of a sample whose parts were judged, with part -> label."""
    if not people:
        return []
    boxes = [person["box"] for person in people]
    if "people" in sample.truth:
        truth = sample.truth["people"]
        matched = match_by_boxes(boxes, [one["box"] for one in truth], MIN_IOU).predicted_of
        return [
            (people[j], {part: label for part, label in truth[i]["parts"].items() if label})
            for i, j in matched.items()
        ]
    largest = max(
        people, key=lambda one: (one["box"][2] - one["box"][0]) * (one["box"][3] - one["box"][1])
    )
    parts = {part: limb for limb, part in LIMBS.items() if not sample.truth["uncaptured"][limb]}
    touches = sample.truth["touches"]
    return [(largest, {p: "support" if touches[limb] else "none" for p, limb in parts.items()})]


def logistic(features: Array, touches: Array, weights: Array) -> Array:
    """Return constant and coefficients of log odds, by maximum likelihood with a ridge on
    standardised columns.
    """
    from scipy.optimize import minimize

    mean = features.mean(0)
    spread = features.std(0) + 1e-9
    columns = np.c_[np.ones(len(features)), (features - mean) / spread]

    def loss(w: Array) -> float:
        odds = columns @ w
        return float(
            (weights * (np.logaddexp(0, odds) - touches * odds)).sum()
            + RIDGE / 2 * (w[1:] ** 2).sum()
        )

    found = minimize(loss, np.zeros(columns.shape[1])).x
    slopes = found[1:] / spread
    return np.array([found[0] - slopes @ mean, *slopes])


def table_of(cases: Sequence[Case], kind: str) -> tuple[Array, Array, Array]:
    """Return features (n, F), whether the parts touch, and weights of the cases of one kind."""
    own = [case for case in cases if case.kind == kind]
    features = [[float(np.nan_to_num(case.features[name])) for name in PARTS[kind]] for case in own]
    touches, weights = np.array([(case.touches, case.weight) for case in own], np.float64).T
    return np.array(features, np.float64), touches, weights


def labelled_shares(samples: Sequence[Sample]) -> dict[str, float]:
    """Return kind of part -> share that touches the world among all labelled people of photos but
    exercises.
    """
    touches: dict[str, list[bool]] = {}
    for sample in samples:
        if sample.set == EXERCISES:
            continue
        for person in sample.truth.get("people", ()):
            for part, label in person["parts"].items():
                if label is not None:
                    kind = part.rpartition("_")[2]
                    touches.setdefault(kind, []).append(TOUCHES[label])
    return {kind: float(np.mean(values)) for kind, values in touches.items()}


def fit_of(cases: Sequence[Case], kind: str, shares: Mapping[str, float]) -> Array:
    """Return constant and coefficients of a kind of part, for the share of touching parts that
    all labelled people have.
    """
    features, touches, weights = table_of(cases, kind)
    found = logistic(features, touches, weights)
    if (share := shares.get(kind.removesuffix(" by distance"))) is not None:
        found[0] += _logit(share) - _logit(float(weights @ touches / weights.sum()))
    return found


def fit_all(
    cases: Sequence[Case], kinds: Sequence[str], shares: Mapping[str, float], *, write: bool
) -> None:
    """Score the collections, then fit these kinds of part on all cases."""
    record = json.loads(TOUCH.read_text())
    scores = record["error on pictures left out"]
    weights = record["parts"]
    for kind in kinds:
        given = [case for case in cases if case.set == CONTACT]
        w = fit_of(given, kind, shares)
        likely = {"contact, pictures left out": left_out(given, kind, shares)}
        for name in COLLECTIONS:
            own = [case for case in cases if case.set == name and case.kind == kind]
            likely[f"{name}, by contact"] = [(case, chance(case, w)) for case in own]
        scores[kind] = {name: words for name, rows in likely.items() if (words := described(rows))}
        w = fit_of(cases, kind, shares)
        weights[kind] = dict(zip(("constant", *PARTS[kind]), w.round(3).tolist(), strict=True))
    record["error on pictures left out"] = {kind: scores[kind] for kind in PARTS}
    record["parts"] = {kind: weights[kind] for kind in PARTS}
    record["fitted on"] |= {kind: pictures_of(cases, kind) for kind in kinds}
    record["fitted on"] = {kind: record["fitted on"][kind] for kind in PARTS}
    print(json.dumps(record, indent=2))
    if write:
        TOUCH.write_text(json.dumps(record, indent=2) + "\n")


def pictures_of(cases: Sequence[Case], kind: str) -> str:
    """Return in words how many pictures have cases of a kind."""
    photos, films = (
        len({case.picture for case in cases if case.kind == kind and (case.weight < 1) == of_film})
        for of_film in (False, True)
    )
    words = f"{photos} photos labelled by two readers"
    return f"{words}, and {films} films with measured forces" if films else words


def left_out(
    cases: Sequence[Case], kind: str, shares: Mapping[str, float]
) -> list[tuple[Case, float]]:
    """Return the photos' parts of one kind, each with its probability by a fit without a tenth of
    the pictures.
    """
    found = []
    for fold in range(10):
        others = [case for case in cases if digest(case.picture + "fold") % 10 != fold]
        w = fit_of(others, kind, shares)
        own = (
            c
            for c in cases
            if c.kind == kind and c.weight == 1 and digest(c.picture + "fold") % 10 == fold
        )
        found += [(case, chance(case, w)) for case in own]
    return found


def chance(case: Case, weights: Array) -> float:
    """Return the probability that the part of a case touches."""
    features = [float(np.nan_to_num(case.features[name])) for name in PARTS[case.kind]]
    odds = weights[0] + weights[1:] @ features
    return float(1 / (1 + np.exp(-odds)))


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
