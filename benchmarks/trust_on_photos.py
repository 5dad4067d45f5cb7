"""Fit the probabilities that a person is right to verdicts of readers.

    python -m benchmarks trust_on_photos gather RESULTS TABLE
    python -m benchmarks trust_on_photos fit [TABLE] [--write]

``gather`` writes the people of the results below RESULTS to TABLE, with the values of their checks,
and keeps the verdicts of people who are in it. A verdict has 1 or 0 for each of pose, place,
contact and size, which a reader judges from the photo, and from front, side and top of the body
with its floor; a person is right if all four are. ``fit`` prints how the probability of each mark,
and of all, agrees with the verdicts, and with ``--write`` writes
``physic_core/judge/trust.json``, fitted to all people. To fit other backends, gather
their results, add verdicts, and fit.

TABLE is by default ``benchmarks/truth/verdicts.json``, of the photos with labelled contact and the
embedded preset. A fit to nine tenths of the repositories scores each tenth.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physic_core.judge.spec import CHECKS
from physic_core.judge.trust import ALL, CAP, probabilities_of, relative_excess
from physic_core.types import MARKS
from physic_core.types.records import USABLE
from physic_testing.metrics import match_by_boxes, resampled_interval

from .fits import fold_of, parser_of, write_record
from .truth.measures import probability_scores

Array = NDArray[np.float64]
Row = Mapping[str, Any]

TRUST = Path(__file__).parents[1] / "physic_core" / "judge" / "trust.json"
VERDICTS = Path(__file__).parent / "truth" / "verdicts.json"
RIDGE = 3.0
"""Weight of half the squared coefficients of standardised columns."""

DRAWS = 1000
SAME_PERSON = 0.9
"""Least overlap of the boxes of one person in two runs."""

TERMS = (
    *("contact_sure", "detected", "lean", "body_in_mask", "low_depth"),
    *("support", "scale_sigma", "limb_sigma", "limb_spread", "hidden_limbs", "unknown_contacts"),
)
"""Checks whose values are in the models."""

OF_CONTACT = ("unknown_contacts",)
"""Those that count for contact alone, and so for all marks together: a surface that the depth lacks
makes neither pose, place, nor size wrong.
"""


def main() -> int:
    """Gather people, or fit."""
    parser = parser_of("trust_on_photos", __doc__, fits=False)
    steps = parser.add_subparsers(dest="step", required=True)
    gather = steps.add_parser("gather")
    gather.add_argument("results", type=Path)
    gather.add_argument("table", type=Path)
    fit = steps.add_parser("fit")
    fit.add_argument("table", type=Path, nargs="?", default=VERDICTS)
    fit.add_argument("--write", action="store_true", help="write the fitted file")
    given = parser.parse_args()
    if given.step == "gather":
        earlier = json.loads(given.table.read_text()) if given.table.exists() else []
        lines = [json.dumps(row) for row in people_of(given.results, earlier)]
        given.table.write_text("[\n" + ",\n".join(lines) + "\n]\n")
        return 0
    rows = [row for row in json.loads(given.table.read_text()) if row["verdicts"]]
    write_record(fit_all(rows), TRUST, write=given.write)
    return 0


def people_of(results: Path, earlier: Sequence[Row]) -> list[Row]:
    """Return a row for each person of the results below a folder, with the verdicts of earlier
    rows.
    """
    from physic_batch.contact_sheet import find_results
    from physic_core import load_reconstruction

    rows: list[Row] = []
    for folder in find_results(results):
        result = load_reconstruction(folder)
        photo = Path(result.photo_name).stem
        of_photo = [row for row in earlier if row["photo"] == photo]
        for index, person in enumerate(result.people):
            box = result.file_pixels(person.box.reshape(2, 2)).ravel().round(1).tolist()
            matched = match_by_boxes(
                [box], [row["box"] for row in of_photo], SAME_PERSON
            ).predicted_of
            kept = {name: of_photo[i][name] for i in matched for name in ("verdicts", "child")}
            checks = {
                check.name: None if check.value is None else float(f"{check.value:.4g}")
                for check in result.checks
                if check.person in (None, index)
            }
            new = {"photo": photo, "box": box, "verdicts": {}, "child": False}
            rows.append(new | kept | {"checks": checks})
    return rows


def fit_all(rows: Sequence[Row]) -> dict[str, Any]:
    """Score people left out, then fit to all; return the fitted file."""
    likely = left_out_probabilities(rows)
    scores = {mark: described(rows, likely[mark], mark) for mark in (*MARKS, ALL)}
    readers = sorted({reader for row in rows for reader in row["verdicts"]})
    return {
        "made by": "benchmarks/trust_on_photos.py",
        "fitted on": f"{len(rows)} people in {len({row['photo'] for row in rows})} photos, judged "
        f"by {len(readers)} reader{'' if len(readers) == 1 else 's'}",
        "agreement of readers": agreement(rows),
        "people who took no part": scores,
        "models": fitted(rows),
    }


def agreement(rows: Sequence[Row]) -> dict[str, str]:
    """Return how far the readers of a person agree, for each mark and for all of them: the share of
    equal verdicts, and Cohen's kappa.
    """
    both = [list(row["verdicts"].values()) for row in judged(rows, ALL) if len(row["verdicts"]) > 1]
    if not both:
        return {}
    marks = {name: np.array([[one[name] for one in pair[:2]] for pair in both]) for name in MARKS}
    marks[ALL] = np.prod([marks[name] for name in MARKS], axis=0)
    sentences = {}
    for name, pairs in marks.items():
        equal = float((pairs[:, 0] == pairs[:, 1]).mean())
        first, second = pairs.mean(0)
        chance = first * second + (1 - first) * (1 - second)
        kappa = (equal - chance) / (1 - chance)
        sentences[name] = f"{equal:.2f} equal, kappa {kappa:.2f}, {len(pairs)} people"
    return sentences


def right_share(rows: Sequence[Row], mark: str) -> float:
    """Return the share of people whose mark is right, mean of the readers."""
    return float(np.mean([rightness(row, mark) for row in judged(rows, mark)]))


def judged(rows: Sequence[Row], mark: str) -> list[Row]:
    """Return the people with verdicts on a mark, or on all."""
    names = set(MARKS if mark == ALL else (mark,))
    return [row for row in rows if all(names <= one.keys() for one in row["verdicts"].values())]


def rightness(row: Row, mark: str) -> float:
    """Return the share of the readers who find a mark of a person right, or all of them."""
    return float(np.mean(verdicts_of(row, mark)))


def verdicts_of(row: Row, mark: str) -> list[bool]:
    """Return whether each reader finds a mark of a person right, or all of them."""
    names = MARKS if mark == ALL else (mark,)
    return [all(one[name] for name in names) for one in row["verdicts"].values()]


def fitted(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the models of each mark and of all."""
    return {mark: fitted_mark(rows, mark) for mark in (*MARKS, ALL)}


def fitted_mark(rows: Sequence[Row], mark: str) -> dict[str, Any]:
    """Return constant and terms of the log odds, by maximum likelihood with a ridge; slopes are at
    most 0.
    """
    rows = judged(rows, mark)
    loads = np.array([loads_of(row) for row in rows], np.float64)
    measured = ~np.isnan(loads).all(0)
    if mark not in ("contact", ALL):
        measured &= ~np.isin(TERMS, OF_CONTACT)
    names = [name for name, any_row in zip(TERMS, measured, strict=True) if any_row]
    loads = loads[:, measured]
    right = np.array([rightness(row, mark) for row in rows])
    usual = np.array([np.nanmedian(column[right >= CAP]) for column in loads.T])
    spread = np.array([np.nanstd(column) for column in loads.T]) + 1e-9
    # What was not measured costs nothing: its load is the usual one.
    weights = likeliest(np.nan_to_num((loads - usual) / spread), right)
    terms = {
        name: {"slope": round(float(slope), 3), "usual": round(float(load), 3)}
        for name, slope, load in zip(names, weights[1:] / spread, usual, strict=True)
        if round(float(slope), 3) < 0
    }
    return {"constant": round(float(weights[0]), 3), "terms": terms}


def likeliest(columns: Array, right: Array) -> Array:
    """Return constant and slopes (1 + T,) of standardised columns (n, T)."""
    from scipy.optimize import minimize

    x = np.c_[np.ones(len(columns)), columns]

    def loss(w: Array) -> tuple[float, Array]:
        odds = x @ w
        chance = 1 / (1 + np.exp(-odds))
        value = (np.logaddexp(0, odds) - right * odds).sum() + RIDGE / 2 * (w[1:] ** 2).sum()
        return float(value), x.T @ (chance - right) + RIDGE * np.r_[0.0, w[1:]]

    bounds = [(None, None), *[(None, 0.0)] * columns.shape[1]]
    start = np.zeros(x.shape[1])
    return np.asarray(minimize(loss, start, jac=True, bounds=bounds, method="L-BFGS-B").x)


def loads_of(row: Row) -> list[float | None]:
    """Return the load of each term of a person; None where unknown."""
    specs = [CHECKS[name] for name in TERMS]
    return [
        relative_excess(row["checks"].get(spec.name), spec.threshold, spec.direction, spec.unit)
        for spec in specs
    ]


def probabilities(rows: Sequence[Row], models: Mapping[str, Any]) -> dict[str, Array]:
    """Return the probability (n,) of each person by fitted models, with its caps, by mark."""
    rows_of_chances = [probabilities_of(row["checks"], models) for row in rows]
    return {mark: np.array([one[mark] for one in rows_of_chances]) for mark in (*MARKS, ALL)}


def left_out_probabilities(rows: Sequence[Row]) -> dict[str, Array]:
    """Return the probability (n,) of each person by fits without a tenth of the repositories, by
    mark.
    """
    fold = np.array([fold_of(row["photo"].partition("__")[0]) for row in rows])
    chances = {mark: np.zeros(len(rows)) for mark in (*MARKS, ALL)}
    for number in sorted(set(fold.tolist())):
        others = [row for row, fold_of_row in zip(rows, fold, strict=True) if fold_of_row != number]
        mine = [row for row, fold_of_row in zip(rows, fold, strict=True) if fold_of_row == number]
        for mark, chance in probabilities(mine, fitted(others)).items():
            chances[mark][fold == number] = chance
    return chances


def described(rows: Sequence[Row], likely: Array, mark: str) -> dict[str, Any]:
    """Return scores over the verdicts of all readers, each with its interval by a bootstrap over
    photos.

    Args:
        rows: people.
        likely: (n,) probabilities.
        mark: whose probabilities they are.
    """
    photos: dict[str, list[tuple[float, float]]] = {}
    chances = dict(zip(map(id, rows), likely.tolist(), strict=True))
    rows = judged(rows, mark)
    for row in rows:
        chance = chances[id(row)]
        marked = [(float(chance), float(right)) for right in verdicts_of(row, mark)]
        photos.setdefault(row["photo"], []).extend(marked)
    groups = list(photos.values())
    scores = {}
    for name, statistic in STATISTICS.items():

        def of_groups(drawn: Sequence[Any], statistic: Any = statistic) -> float:
            pairs = np.array([pair for group in drawn[0] for pair in group])
            return float(statistic(pairs[:, 0], pairs[:, 1]))

        low, high = resampled_interval([groups], of_groups, DRAWS)
        scores[name] = f"{of_groups([groups]):.3f} ({low:.3f} to {high:.3f})"
    return {"people": len(rows), "photos": len(groups), **scores}


def _share_right(among: Callable[[Array], NDArray[np.bool_]]) -> Callable[..., float]:
    def share(chance: Array, right: Array) -> float:
        chosen = among(chance)
        return float(right[chosen].mean()) if chosen.any() else np.nan

    return share


def _probability_score(name: str) -> Callable[..., float]:
    def score(chance: Array, right: Array) -> float:
        return probability_scores(chance.tolist(), right.astype(bool).tolist())[name]

    return score


STATISTICS: dict[str, Callable[..., float]] = {
    "AUC": _probability_score("auc"),
    "calibration error": _probability_score("calibration"),
    "usable and right": _share_right(lambda chance: chance >= USABLE),
    "doubtful and right": _share_right(lambda chance: chance < USABLE),
    "right above one half": _share_right(lambda chance: chance >= CAP),
    "share usable": lambda chance, right: float((chance >= USABLE).mean()),
}
"""Name -> figure of probabilities (n,) and verdicts 0 or 1 (n,)."""
