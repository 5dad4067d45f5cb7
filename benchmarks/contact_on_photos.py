"""Fit what photos say of contact on labelled photos and films with measured forces.

    python -m benchmarks.contact_on_photos sample DATA OUT [--films N]
    python -m benchmarks.contact_on_photos fit DATA OUT [--write]

``sample`` runs the embedded preset on the labelled photos of DATA/contact and DATA/photos, and on N frames of each of
the films of fits, and keeps the features of each person in a file of OUT; an interrupted run continues. ``fit`` fits,
prints the scores of photos and films that were left out in turn, and with ``--write`` writes two files:

- ``physic_core/body/feet_in_picture.json``: which feet touch something, by keypoints alone; on photos alone.
- ``physic_core/engine/contact/parts.json``: contact of body parts with the scene; on photos and films.
- ``people_farther`` of the embedded point map is printed, not written: median and spread over people on their feet.

The labels of DATA/photos lie beside the benchmark: two readers labelled them apart, from the pictures alone. A frame of
a film counts half, since the frames of a film are not independent.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from .truth.contact import MIN_IOU, TOUCHES
from .truth.measures import match_boxes, probability_scores
from .truth.scores import LIMBS
from .truth.sets import FILMS_OF_FITS, SETS, Sample, picture_of

if TYPE_CHECKING:
    from physic_core import Pipeline
    from physic_core.engine.contact.features import Distances
    from physic_core.engine.contact.method import Touch
    from physic_core.engine.contact.problem import ContactInput
    from physic_core.pipeline.estimate import Estimates

Array = NDArray[np.float64]

CORE = Path(__file__).parents[1] / "physic_core"
LABELS_OF_PHOTOS = Path(__file__).parent / "truth" / "labels_of_photos.json"
FRAME_WEIGHT = 0.5
RIDGE = 1.0
"""Weight of half the squared coefficients of standardised features."""

PICTURE = (
    "lower than the other foot, trunks",
    "heel below the toes, trunks",
    "other shin, trunks",
    "other knee bent, radians",
)
PARTS: dict[str, tuple[str, ...]] = {
    "foot": ("log odds", "picture", "lifted", "lifted, hands up"),
    "hand": ("log odds", "lifted", "lifted, hand up"),
    "seat": ("log odds above even", "thighs"),
    "back": ("log odds",),
    "limb": ("log odds",),
}
"""Kind of part -> its features, see :func:`physic_core.engine.contact.parts.part_features`."""


@dataclass(frozen=True)
class Case:
    """A judged part of one person.

    Attributes:
        group: photo or film, which is left out at once.
        kind: of the part.
        features: by name; "picture" holds the features of the foot in the picture, ().
        touches: whether it touches the world.
        weight: of the case.
    """

    group: str
    kind: str
    features: Mapping[str, float]
    picture: tuple[float, ...]
    touches: bool
    weight: float


def main() -> int:
    """Sample or fit."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.contact_on_photos", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("step", choices=("sample", "fit"))
    parser.add_argument("data", type=Path, help="folder with contact, photos and truth")
    parser.add_argument("out", type=Path)
    parser.add_argument("--films", type=int, default=6, metavar="N", help="frames of each film")
    parser.add_argument("--write", action="store_true", help="write the fitted files")
    given = parser.parse_args()
    samples = samples_of(given.data, given.films)
    if given.step == "sample":
        from physic_core import Pipeline, load_config

        with Pipeline(load_config(preset="embedded")) as pipeline:
            for sample in samples:
                keep_features(sample, pipeline, given.out)
        return 0
    cases, ratios = cases_of(samples, given.out)
    spread = 1.4826 * np.median(np.abs(ratios - np.median(ratios)))
    print(f"people_farther: median {np.median(ratios):.3f}, spread {spread:.3f}, {len(ratios)} people")
    fit_all(cases, write=given.write)
    return 0


def samples_of(data: Path, frames: int) -> list[Sample]:
    """Return the labelled photos and the first N frames of each film of fits."""
    photos = SETS["contact"](data / "contact")
    files = {file.stem: file for file in (data / "photos").iterdir()}
    more = json.loads(LABELS_OF_PHOTOS.read_text())
    photos += [Sample("photos", name, name, files[name], truth={"people": people}) for name, people in more.items()]
    films: dict[str, list[Sample]] = {}
    for sample in SETS["parkour"](data / "truth" / "parkour"):
        if sample.group in FILMS_OF_FITS:
            films.setdefault(sample.group, []).append(sample)
    return [*photos, *(frame for own in films.values() for frame in own[:frames])]


def keep_features(sample: Sample, pipeline: Pipeline, out: Path) -> None:
    """Run the pipeline on a sample and write the features of its people."""
    file = out / f"{sample.set}-{sample.name}.json"
    if file.exists():
        return
    import cv2

    from physic_core.engine.contact.features import feature_columns
    from physic_core.engine.contact.method import ContactMethod
    from physic_core.engine.contact.parts import part_features
    from physic_core.engine.contact.probability import contact_model
    from physic_core.errors import PhysicError

    kept: list[dict[str, dict[str, list[float]]]] = []
    estimates: list[Any] = []
    touch = ContactMethod.touch

    def recorded(self: ContactMethod, given: ContactInput, near: Distances) -> Touch:
        features = part_features(given, contact_model().probabilities(feature_columns(given, near))[0])
        kept.append({part: {key: v.tolist() for key, v in own.items()} for part, own in features.items()})
        return touch(self, given, near)

    def complete(found: Estimates) -> Estimates:
        estimates.append(found)
        return found

    with patch.object(ContactMethod, "touch", recorded):
        try:
            pipeline(cv2.cvtColor(picture_of(sample), cv2.COLOR_BGR2RGB), complete=complete)
        except PhysicError as error:
            print(f"{sample.set} {sample.name}: {error}", file=sys.stderr)
    people: list[dict[str, Any]] = []
    height, width = picture_of(sample).shape[:2]
    for e in estimates if kept else ():
        factor = width / e.image.shape[1], height / e.image.shape[0]
        for i, box in enumerate(np.asarray(e.people.boxes, np.float64)):
            own = {part: {k: v[i] for k, v in each.items()} for part, each in kept[0].items()}
            people.append(
                {
                    "box": (box * np.tile(factor, 2)).tolist(),
                    "parts": own,
                    "keypoints": np.asarray(e.keypoints.points[i], np.float64).tolist(),
                    "names": list(e.keypoints.joint_set.names),
                    "standing": float(e.stance.score[i]),
                    "farther": list(e.scene.people_farther or ()),
                }
            )
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(people))
    print(sample.set, sample.name, len(people), file=sys.stderr, flush=True)


def cases_of(samples: Sequence[Sample], out: Path) -> tuple[list[Case], Array]:
    """Return the judged parts, and log(scale by soles / scale by torso) of people who touch with a foot."""
    from physic_core.body.feet_in_picture import foot_features

    cases: list[Case] = []
    ratios = []
    for sample in samples:
        people = json.loads((out / f"{sample.set}-{sample.name}.json").read_text())
        for one, judged in judged_parts(sample, people):
            points = np.array(one["keypoints"], np.float64)[None]
            picture = foot_features(points, one["names"])[0]
            for part, touches in judged.items():
                name = part.replace("forearm", "lower_arm")
                if name not in one["parts"]:
                    continue
                features = {key: float(np.nan_to_num(value)) for key, value in one["parts"][name].items()}
                kind = name.rpartition("_")[2] if name.rpartition("_")[2] in PARTS else "limb"
                foot = tuple(picture[int(part.startswith("right"))]) if kind == "foot" else ()
                weight = FRAME_WEIGHT if sample.frame is not None else 1.0
                cases.append(Case(sample.group, kind, features, foot, touches, weight))
            standing = any(touches for part, touches in judged.items() if part.endswith("foot"))
            if sample.frame is None and standing and one["farther"] and np.isfinite(one["standing"]):
                ratios.append(one["standing"] * one["farther"][1] + one["farther"][0])
    return cases, np.array(ratios)


def judged_parts(
    sample: Sample, people: Sequence[Mapping[str, Any]]
) -> list[tuple[Mapping[str, Any], dict[str, bool]]]:
    """Return the found people of a sample whose parts were judged, with part -> whether it touches the world."""
    if not people:
        return []
    boxes = [person["box"] for person in people]
    if "people" in sample.truth:
        truth = sample.truth["people"]
        matched = match_boxes(boxes, [one["box"] for one in truth], MIN_IOU)
        labels = {j: truth[i]["parts"] for i, j in matched.items()}
        return [
            (people[j], {part: TOUCHES[label] for part, label in own.items() if label is not None})
            for j, own in labels.items()
        ]
    largest = max(people, key=lambda one: (one["box"][2] - one["box"][0]) * (one["box"][3] - one["box"][1]))
    limbs = {part: limb for limb, part in LIMBS.items() if not sample.truth["uncaptured"][limb]}
    return [(largest, {part: bool(sample.truth["touches"][limb]) for part, limb in limbs.items()})]


def logistic(features: Array, touches: Array, weights: Array) -> Array:
    """Return constant and coefficients of log odds, by maximum likelihood with a ridge on standardised columns."""
    from scipy.optimize import minimize

    mean, spread = features.mean(0), features.std(0) + 1e-9
    columns = np.c_[np.ones(len(features)), (features - mean) / spread]

    def loss(w: Array) -> float:
        odds = columns @ w
        return float((weights * (np.logaddexp(0, odds) - touches * odds)).sum() + RIDGE / 2 * (w[1:] ** 2).sum())

    found = minimize(loss, np.zeros(columns.shape[1])).x
    slopes = found[1:] / spread
    return np.array([found[0] - slopes @ mean, *slopes])


def picture_model(cases: Sequence[Case]) -> tuple[Array, Array]:
    """Return constant and coefficients of the feet in the picture, and the means that stand for unknown features."""
    feet = [case for case in cases if case.kind == "foot" and case.weight == 1 and np.isfinite(case.picture).all()]
    features = np.array([case.picture for case in feet])
    return logistic(features, np.array([c.touches for c in feet], float), np.ones(len(feet))), features.mean(0)


def part_table(cases: Sequence[Case], kind: str, picture: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return the features, whether the parts touch, and the weights of the cases of one kind."""
    (coefficients, mean), rows = picture, []
    for case in (case for case in cases if case.kind == kind):
        features = dict(case.features)
        if kind == "foot":
            features["picture"] = coefficients[0] + coefficients[1:] @ np.where(
                np.isfinite(case.picture), case.picture, mean
            )
        rows.append((*(features[name] for name in PARTS[kind]), case.touches, case.weight))
    table = np.array(rows, np.float64)
    return table[:, :-2], table[:, -2], table[:, -1]


def fit_all(cases: Sequence[Case], *, write: bool) -> None:
    """Fit on all cases, and score each photo and film by a fit without it."""
    left_out: dict[str, list[tuple[float, bool, float]]] = {kind: [] for kind in PARTS}
    by_picture: list[tuple[float, bool, float]] = []
    for group in sorted({case.group for case in cases}):
        rest, own = [c for c in cases if c.group != group], [c for c in cases if c.group == group]
        picture = picture_model(rest)
        for kind in PARTS:
            if not any(case.kind == kind for case in own):
                continue
            w = logistic(*part_table(rest, kind, picture))
            features, touches, weights = part_table(own, kind, picture)
            left_out[kind] += zip(sigmoid(w[0] + features @ w[1:]), touches > 0, weights, strict=True)
            if kind == "foot":
                odds = features[:, PARTS["foot"].index("picture")]
                by_picture += zip(sigmoid(odds), touches > 0, weights, strict=True)
    error = {kind: described(rows) for kind, rows in left_out.items()}
    coefficients, mean = picture = picture_model(cases)
    fitted = {
        kind: dict(
            zip(("constant", *PARTS[kind]), logistic(*part_table(cases, kind, picture)).round(3).tolist(), strict=True)
        )
        for kind in PARTS
    }
    photos = len({c.group for c in cases if c.weight == 1})
    films = len({c.group for c in cases if c.weight < 1})
    parts = {
        "made by": "benchmarks/contact_on_photos.py",
        "fitted on": f"{photos} photos labelled by two readers, and {films} films with measured forces",
        "held-out error": error,
        "parts": fitted,
    }
    feet = {
        "made by": "benchmarks/contact_on_photos.py",
        "fitted on": f"{photos} photos labelled by two readers",
        "held-out error": described(by_picture),
        "constant": round(float(coefficients[0] + coefficients[1:] @ mean), 3),
        "features": {
            name: {"weight": round(float(w), 3), "mean": round(float(m), 3)}
            for name, w, m in zip(PICTURE, coefficients[1:], mean, strict=True)
        },
    }
    print(json.dumps({"parts": parts, "feet": feet}, indent=2))
    if write:
        (CORE / "engine" / "contact" / "parts.json").write_text(json.dumps(parts, indent=2) + "\n")
        (CORE / "body" / "feet_in_picture.json").write_text(json.dumps(feet, indent=2) + "\n")


def sigmoid(odds: Array) -> Array:
    """Return probabilities of log odds."""
    return np.asarray(1 / (1 + np.exp(-odds)))


def described(rows: Sequence[tuple[float, bool, float]]) -> dict[str, str]:
    """Return the scores of photos and of films in words."""
    found = {}
    for name, chosen in (("photos", [r for r in rows if r[2] == 1]), ("films", [r for r in rows if r[2] < 1])):
        if chosen:
            score = probability_scores([r[0] for r in chosen], [r[1] for r in chosen])
            found[name] = (
                f"{len(chosen)} judged, {sum(r[1] for r in chosen)} touch: AUC {score['auc']:.2f}, balanced "
                f"{score['balanced']:.2f}, Brier {score['brier']:.3f} (constant {score['constant']:.3f})"
            )
    return found


if __name__ == "__main__":
    sys.exit(main())
