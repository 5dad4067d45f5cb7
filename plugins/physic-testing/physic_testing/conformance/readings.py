"""Readings: what known mistakes of a wrapper make of the truth, and whether an output is one of
them.

An output is compared as a vector for each unit, a person or a photo. A mistake puts it off by a
known vector. The share of that vector in what it is off by is 1 with the mistake and 0 without,
whatever other errors a network has. It counts beyond three standard errors over the units. The same
share is measured between the outputs for a photo and for the changed photo: there most errors of a
network cancel, and need no truth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from physic_testing.conformance.changes import Change, change_of, changed_case
from physic_testing.conformance.expect import CheckFailed, CheckSkipped

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

_T = TypeVar("_T")

Values: TypeAlias = "dict[str, Any]"
"""An output in the form in which it is compared: names -> arrays."""

Make: TypeAlias = "Callable[[Values, Case], Values]"
"""Values of the truth, and the photo -> values with a mistake."""

THREE_ERRORS = 0.99865
"""Probability below three standard errors; few units need more of them for it (Student's t
distribution).
"""

SURE_MARGINS = 5.0
SURE_SHARE = 0.1
"""A mean of this many margins counts from this share of its limit on: networks err that evenly only
by a mistake.
"""

MIN_UNITS = 3
"""Units without which nothing is known of a bias."""

MADE = 0.6
"""Share above which a mistake is made; it is a half of an output that has nothing to do with the
photo.
"""

_LOST = 10  # sizes of a mistake from which on a scatter says that none can be told
_TOO_MUCH = 1.5  # of a mistake that is made once
# of the variance of the truth: a picture that is off by more shows little of the photo
_UNLIKE = 0.7
_PAIRED = 0.7  # of this share, between the outputs for two photos
_PARTS = 10, 1000  # numbers of a vector that is no picture
_TELLING = 0.02  # share of the largest vector from which on a unit shows a mistake


@dataclass(frozen=True)
class Reading:
    """What a known mistake makes of the truth.

    Attributes:
        words: end of the sentence "the output is ...".
        make: values of the truth, and the photo -> values with the mistake.
        hint: likely cause.
        size: of a mistake that has any size, how large that of ``make`` is; 0 if it is made or not.
        unit: of the size.
        limit: largest size that is treated as zero, or the share from which on a mistake without a
            size is made.
        in_pairs: whether pairs of photos are asked, too.
    """

    words: str
    make: Make
    hint: str = ""
    size: float = 0.0
    unit: str = ""
    limit: float = MADE
    in_pairs: bool = True


@dataclass(frozen=True)
class Group:
    """What is compared by one check.

    Attributes:
        check: name of the check.
        what: what the contract requires.
        unit: of the errors.
        units: values, values of the truth, and the photo -> a vector for each unit, NaN where
            unknown.
        readings: other readings of the output.
        centred: only differences between the units count.
        rough: largest median error over the units.
        order: values -> rows (N, J, D) whose order is tested, and their names.
        others: what all others have too much, in words with a hint, is a reading.
        after: names of further checks that come first.
    """

    check: str
    what: str
    unit: str
    units: Callable[[Values, Values, Case], Sequence[FloatArray]]
    readings: tuple[Reading, ...] = ()
    centred: bool = False
    rough: float = float("inf")
    order: tuple[str, Sequence[str], int] | None = None
    others: tuple[str, str] | None = None
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """How the outputs of an interface are compared.

    Attributes:
        parse: output, photo and values of the truth -> values of the output.
        truth: output and photo -> values of the truth.
        act: values, change and photo -> values of the changed photo.
        groups: what is compared.
        read: class that documents the output.
        exact: values and values of the truth -> numbers of both, and the tolerance of rounding.
        changes: changes of photos that are asked.
        after: names of checks that come first.
    """

    parse: Callable[[Any, Case, Values], Values]
    truth: Callable[[Any, Case], Values]
    act: Callable[[Values, Change, Case], Values]
    groups: tuple[Group, ...]
    read: str
    exact: Callable[[Values, Values], tuple[FloatArray, FloatArray, float]]
    changes: tuple[str, ...] = ()
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class Pair:
    """Outputs for a photo and for the changed photo.

    Attributes:
        case: the changed photo.
        own: values of the output for it.
        wanted: values of the output for the photo, changed as the photo was.
        truth: values of the changed photo.
        before: the photo, with the values of its truth and the change.
    """

    case: Case
    own: Values
    wanted: Values
    truth: Values
    before: tuple[Case, Values, Change]


@dataclass(frozen=True)
class Share:
    """Share of a mistake in what outputs are off by.

    Attributes:
        mean: over the units.
        margin: three standard errors of it.
        left: mean square that is left without the mistake, over that with it.
        before: root mean square error as the output is.
        after: the same if the mistake is undone.
    """

    mean: float
    margin: float
    left: float
    before: float
    after: float


def share_of(
    off: Sequence[FloatArray],
    mistakes: Sequence[FloatArray],
    *,
    centred: bool = False,
    least: float | None = None,
) -> Share | None:
    """Return the share of mistakes (K vectors) in what outputs are off by; None if too few units
    show it.

    Args:
        off: what the output of each unit is off by.
        mistakes: what the mistake would put it off by.
        centred: only differences between the units count.
        least: mean square of a mistake from which on a unit shows it; units then count by it, else
            all count alike.
    """
    from scipy.special import stdtrit

    if centred and off:
        means = [np.nanmean([v.mean() for v in vectors]) for vectors in (off, mistakes)]
        off = [v - means[0] for v in off]
        mistakes = [v - means[1] for v in mistakes]
    rows = []
    for r, m in zip(off, mistakes, strict=True):
        known = np.isfinite(r) & np.isfinite(m)
        if known.any():
            own = r[known]
            other = m[known]
            rows.append((float(own @ other), float(other @ other), float(own @ own), len(own)))
    table = np.array(rows, np.float64).reshape(-1, 4)
    size = table[:, 1] / np.maximum(table[:, 3], 1)
    telling = (size > max(_TELLING * size.max(initial=0), least or 0)) & (size > 0)
    is_alike = not centred and least is None and telling.sum() >= MIN_UNITS
    table = (
        table if centred else table[telling] if is_alike or least is not None else table[size > 0]
    )
    # Units count alike, or by how much of the mistake they show; then few of them may have all the
    # weight.
    weight = 1 / table[:, 1] if is_alike else np.ones(len(table))
    weights = weight * table[:, 1]
    if len(table) < MIN_UNITS or table[:, 1].sum() <= 1e-18:
        return None
    count = float(weights.sum() ** 2 / (weights**2).sum()) if not centred else float(len(table))
    if count < 1.01:
        return None
    mean = float((weight * table[:, 0]).sum() / (weight * table[:, 1]).sum())
    scatter = weight * (table[:, 0] - mean * table[:, 1])
    error = np.sqrt((scatter**2).sum() * count / (count - 1)) / (weight * table[:, 1]).sum()
    margin = float(stdtrit(count - 1, THREE_ERRORS) * error)
    if not centred and least is None:  # the places of single joints cancel between two photos
        margin = max(margin, _margin_over_parts(off, mistakes, mean))
    before = float(table[:, 2].sum())
    share = mean
    after = before - 2 * share * float(table[:, 0].sum()) + share**2 * float(table[:, 1].sum())
    left = max(after, 0.0) / max(before, 1e-30)
    once = max(before - 2 * float(table[:, 0].sum()) + float(table[:, 1].sum()), 0.0)
    number = table[:, 3].sum()
    return Share(mean, margin, left, float(np.sqrt(before / number)), float(np.sqrt(once / number)))


def _margin_over_parts(
    off: Sequence[FloatArray], mistakes: Sequence[FloatArray], mean: float
) -> float:
    """Return three standard errors of a share over the parts of the vectors; 0 of vectors that are
    pictures, or short.

    Networks place single joints by annotations of their own.
    """
    from scipy.special import stdtrit

    if len({len(vector) for vector in off}) != 1 or not _PARTS[0] <= len(off[0]) <= _PARTS[1]:
        return 0.0
    r = np.array(off)
    m = np.array(mistakes)
    known = np.isfinite(r) & np.isfinite(m)
    weight = 1 / np.maximum((np.where(known, m, 0) ** 2).sum(axis=1, keepdims=True), 1e-30)
    r = np.where(known, r, 0)
    m = np.where(known, m, 0)
    weight = np.where((m**2).sum(axis=1, keepdims=True) > 0, weight, 0)
    tops = (weight * r * m).sum(axis=0)
    sizes = (weight * m * m).sum(axis=0)
    count = int((sizes > 0).sum())
    if count < 2:
        return 0.0
    error = np.sqrt(((tops - mean * sizes) ** 2).sum() * count / (count - 1)) / sizes.sum()
    return float(stdtrit(count - 1, THREE_ERRORS) * error)


def is_made(share: Share, reading: Reading, *, in_pairs: bool = False) -> bool:
    """Return whether outputs have a mistake: by a share or a size above its limit, or surely not
    zero.
    """
    if not reading.size:
        limit = reading.limit * (_PAIRED if in_pairs else 1)
        return share.mean - share.margin > limit and share.mean < _TOO_MUCH
    mean = abs(share.mean) * reading.size
    margin = share.margin * reading.size
    return mean - margin > reading.limit or (
        mean > SURE_SHARE * reading.limit and mean > SURE_MARGINS * margin and mean > 1e-9
    )


def check_group(subject: BackendUnderTest, table: Table, group: Group) -> tuple[str, ...]:
    """Raise CheckFailed if outputs are one of the readings of a group; return which readings they
    cannot tell.

    Raises:
        CheckSkipped: too few photos have a valid output.
    """
    evidence = values_of(subject, table)
    truths = [(case, truth) for case, _, truth in evidence]
    own = [group.units(values, truth, case) for case, values, truth in evidence]
    true = _once(
        subject,
        group,
        None,
        truths,
        lambda: [group.units(truth, truth, case) for case, truth in truths],
    )
    off = _differences(own, true)
    known = [unit for unit in off if np.isfinite(unit).any()]
    if len(known) < MIN_UNITS:
        raise CheckSkipped(f"{len(known)} people or photos to compare, {MIN_UNITS} are needed")
    rough = float(np.median([np.sqrt(np.nanmean(unit**2)) for unit in known]))
    readings = (*group.readings, *_order(group, evidence))
    made = []
    unseen = []
    is_blind = "ignores_image" in subject.capabilities
    pairs = () if is_blind or _is_unlike(off, true) else pairs_of(subject, table)
    before = _differences(
        [group.units(p.own, p.truth, p.case) for p in pairs],
        [group.units(p.wanted, p.truth, p.case) for p in pairs],
    )
    for reading in readings:
        mistakes = _once(
            subject, group, reading.make, truths, partial(_mistakes, reading, group, truths, true)
        )
        shares = [share_of(off, mistakes, centred=group.centred)]
        if pairs and reading.in_pairs:
            changed_truths = [(pair.case, pair.truth) for pair in pairs]
            make = partial(_of_pairs, reading, group, table, pairs)
            apart = _bands(_once(subject, group, reading.make, changed_truths, make))
            shares.append(
                share_of(_bands(before), apart, least=_least(mistakes, centred=group.centred))
            )
        told = [share for share in shares if share is not None]
        for share in told:
            if is_made(share, reading, in_pairs=share is not shares[0]):
                made.append((share.left, reading, share, share is shares[0]))
        if told and not is_blind and reading in group.readings:
            unseen += _unseen(reading, min(share.margin for share in told))
    if (
        group.others is not None
        and (common := _of_others(off)) is not None
        and common.mean - common.margin > MADE
    ):
        made.append(
            (common.left, Reading(group.others[0], lambda v, _: v, group.others[1]), common, True)
        )
    if rough > group.rough or (made and not is_blind):
        best = min(made, key=lambda item: (round(item[0], 3), item[1].size)) if made else None
        raise CheckFailed(group.what, _found(group, rough, best), best[1].hint if best else "")
    return tuple(unseen)


def _once(
    subject: BackendUnderTest,
    group: Group,
    mistake: Make | None,
    truths: Sequence[tuple[Case, Values]],
    make: Callable[[], _T],
) -> _T:
    """Return what is made of photos, their truth and a mistake, once for all backends that share
    it.
    """
    photos = (
        (case.name, case.size, truth.get("unknown"), truth.get("names")) for case, truth in truths
    )
    key = (group.check, mistake, *photos)
    if key not in subject.of_photos:
        subject.of_photos[key] = make()
    found: _T = subject.of_photos[key]
    return found


def _unseen(reading: Reading, margin: float) -> list[str]:
    """Return in words how much of a mistake is lost in three standard errors of ``margin``, if that
    is much.
    """
    if not reading.size:
        return (
            [f"{reading.words} (uncertain by {margin:.0%} of it)"]
            if margin + reading.limit > 1
            else []
        )
    error = margin * reading.size
    least = min(reading.limit + error, max(SURE_SHARE * reading.limit, SURE_MARGINS * error))
    if least <= reading.size:
        return []
    size = (
        f"by less than {least:.2g}{reading.unit}"
        if least < _LOST * reading.size
        else "by any amount"
    )
    return [f"{reading.words}, {size}"]


def _found(group: Group, rough: float, best: tuple[float, Reading, Share, bool] | None) -> str:
    """Return in words what outputs are."""
    if best is None:
        return f"an error of {rough:.3g} {group.unit} in the median"
    _, reading, share, is_truth = best
    where = "" if is_truth else ", between a photo and the same photo changed"
    if reading.size:
        mean, margin = (value * reading.size for value in (share.mean, share.margin))
        return (
            f"{mean:+.3g}{reading.unit} {reading.words}, with three standard errors of "
            f"{margin:.2g}{where}"
        )
    return (
        f"an error of {share.before:.3g} {group.unit}, but of {share.after:.3g} if it is "
        f"{reading.words}{where}"
    )


def values_of(subject: BackendUnderTest, table: Table) -> list[tuple[Case, Values, Values]]:
    """Return the photos of people with the values of output and truth."""
    if "values" not in subject.kept:
        found = []
        for case, answer in subject.evidence():
            truth = table.truth(answer, case)
            found.append((case, table.parse(answer, case, truth), truth))
        subject.kept["values"] = found
    kept: list[tuple[Case, Values, Values]] = subject.kept["values"]
    return kept


def pairs_of(subject: BackendUnderTest, table: Table) -> list[Pair]:
    """Return the pairs of photos of which the backend has a valid output; none of a backend that
    knows worlds alone.
    """
    if "pairs" not in subject.kept:
        found: list[Pair] = []
        for case, values, truth in values_of(subject, table):
            if case.name in subject.paired_names:
                found += _pairs(subject, table, case, values, truth)
        subject.kept["pairs"] = found
    kept: list[Pair] = subject.kept["pairs"]
    return kept


def _pairs(
    subject: BackendUnderTest, table: Table, case: Case, values: Values, truth: Values
) -> list[Pair]:
    """Return the pairs of one photo."""
    found = []
    for name in table.changes:
        change = change_of(case, name)
        other = changed_case(case, change)
        answer = subject.answer_of(other, case)
        if answer is None:
            return []
        true = table.act(truth, change, case)
        found.append(
            Pair(
                other,
                table.parse(answer, other, true),
                table.act(values, change, case),
                true,
                (case, truth, change),
            )
        )
    return found


def _mistakes(
    reading: Reading,
    group: Group,
    truths: Sequence[tuple[Case, Values]],
    true: Sequence[Sequence[FloatArray]],
) -> list[FloatArray]:
    """Return by what a mistake puts outputs off."""
    return _differences(
        [group.units(reading.make(truth, case), truth, case) for case, truth in truths], true
    )


def _of_pairs(
    reading: Reading, group: Group, table: Table, pairs: Sequence[Pair]
) -> list[FloatArray]:
    """Return by what a mistake puts the outputs for photo and changed photo apart."""
    own = []
    wanted = []
    for pair in pairs:
        case, truth, change = pair.before
        made = table.act(reading.make(truth, case), change, case)
        own.append(group.units(reading.make(pair.truth, pair.case), pair.truth, pair.case))
        wanted.append(group.units(made, pair.truth, pair.case))
    return _differences(own, wanted)


def _differences(
    own: Sequence[Sequence[FloatArray]], other: Sequence[Sequence[FloatArray]]
) -> list[FloatArray]:
    return [
        np.asarray(a, np.float64) - b
        for photo, second in zip(own, other, strict=True)
        for a, b in zip(photo, second, strict=True)
    ]


def _is_unlike(off: Sequence[FloatArray], true: Sequence[Sequence[FloatArray]]) -> bool:
    """Return whether outputs are pictures that have little of the truth: they do not change as the
    photo does.
    """
    pictures = [
        (r, t)
        for r, t in zip(off, (t for photo in true for t in photo), strict=True)
        if len(r) > _PARTS[1]
    ]
    error, spread = (
        sum(float(np.nanvar(v)) for v in side)
        for side in (zip(*pictures, strict=True) if pictures else ((), ()))
    )
    return error > _UNLIKE * spread


def _least(mistakes: Sequence[FloatArray], *, centred: bool) -> float:
    """Return the mean square of a mistake from which on a pair shows it."""
    known = [mistake[np.isfinite(mistake)] for mistake in mistakes if np.isfinite(mistake).any()]
    middle = float(np.mean([mistake.mean() for mistake in known])) if centred and known else 0.0
    return _TELLING * float(
        np.mean([((mistake - middle) ** 2).mean() for mistake in known] or [0.0])
    )


def _bands(vectors: Sequence[FloatArray]) -> list[FloatArray]:
    """Return pictures as four bands each, which are units of a pair: most errors of a network
    cancel there.
    """
    return [
        band
        for vector in vectors
        for band in (np.array_split(vector, 4) if len(vector) > _PARTS[1] else [vector])
    ]


def _of_others(off: Sequence[FloatArray]) -> Share | None:
    """Return the share in each unit of what all others have too much, so that none explains
    itself.
    """
    table = np.array(off)
    total = np.nansum(table, axis=0)
    count = np.isfinite(table).sum(axis=0)
    others = (total - np.nan_to_num(table)) / np.maximum(count - np.isfinite(table), 1)
    return share_of(list(table), list(others))


def _order(group: Group, evidence: Sequence[tuple[Case, Values, Values]]) -> list[Reading]:
    """Return as a reading the order in which rows fit the truth best; none if it is the stated
    one.
    """
    from scipy.optimize import linear_sum_assignment

    if group.order is None:
        return []
    key, names, axis = group.order
    names = names or evidence[0][2]["names"]
    apart = []
    for _, values, truth in evidence:
        own, true = (np.moveaxis(v[key], axis, 1) for v in (values, truth))
        flat = (
            (len(own), len(own[0]) if len(own) else len(names), -1)
            if len(own)
            else (0, len(names), 1)
        )
        own = own.reshape(flat)
        true = true.reshape(flat)
        apart.append(np.linalg.norm(own[:, :, None] - true[:, None], axis=3))
    cost = np.concatenate(apart)
    known = np.isfinite(cost)
    mean = np.where(known, cost, 0).sum(0) / np.maximum(known.sum(0), 1)
    best = linear_sum_assignment(
        np.where(known.sum(0) < MIN_UNITS, np.nanmax(mean, initial=1.0) * 10, mean)
    )[1]
    moved = [j for j in range(len(best)) if best[j] != j]
    if not moved:
        return []
    pairs = ", ".join(f"{names[j]} for {names[best[j]]}" for j in moved[:4])
    return [
        Reading(
            f"reordered: {pairs}",
            lambda v, _: v | {key: np.take(v[key], best, axis)},
            f"Is it the order of another data set? It is {', '.join(names[:5])}, ...",
        )
    ]


def between(key: str, one: Make, other: Make) -> Make:
    """Return the ``make`` of a reading that is half of the way from a change to the opposite one.

    Outputs that show little of the photo have no share in it.
    """

    def make(values: Values, case: Case) -> Values:
        return values | {key: values[key] + (one(values, case)[key] - other(values, case)[key]) / 2}

    return make


def changed(**changes: Callable[[Any], Any]) -> Make:
    """Return the ``make`` of a reading that changes some values by functions of them."""
    return lambda values, _: (
        values | {name: change(values[name]) for name, change in changes.items()}
    )
