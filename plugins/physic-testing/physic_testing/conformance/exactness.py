"""The check that the output of a perfect network is the truth, and words for what is off if it is
not.

A wrapper of a network is tested alone with a network that knows the truth. Whether a backend is
such a wrapper shows in its output: no real network returns the truth to rounding, or exact
multiples of it, for half of what it returns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from physic_testing.conformance.accuracy import ERRORS, measure_errors
from physic_testing.conformance.expect import CheckFailed, CheckSkipped
from physic_testing.conformance.readings import values_of

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.readings import Table, Values

PROVEN = 0.5
"""Share of pixels, points or rotations on one line with the truth; shipped networks have at most a
tenth.
"""

MAX_LARGEST = 0.02
"""Share of an output that may be its largest value; more of it is clipped."""

MAX_FACTOR = 0.02
"""Deviation of the common factor from 1 that is treated as zero."""

FACTORS = (0.3, 3.0)
"""Factors of a line that can prove anything: a constant lies on one of factor 0."""

_SAMPLES = 4000
_LINES = 64


class Agreement(NamedTuple):
    """How an output agrees with the truth of a photo.

    Attributes:
        share: share of the output that is the truth to rounding.
        on_line: share that is offset + factor * truth to rounding; the better of this line and the
            truth itself.
        factor: of that line; a power for depth, which is compared in logarithms.
        offset: of that line, in the unit of the values.
    """

    share: float
    on_line: float
    factor: float = 1.0
    offset: float = 0.0


def is_proven(subject: BackendUnderTest, table: Table) -> bool:
    """Return whether half of the output is the truth, in the median photo."""
    return bool(
        np.median([agreement(table, v, t).share for _, v, t in values_of(subject, table)]) >= PROVEN
    )


def check_is_exact(subject: BackendUnderTest, table: Table) -> None:
    """The output is the truth in all photos of people if this is declared, or if the output itself
    proves it.
    """
    evidence = values_of(subject, table)
    found = [agreement(table, values, truth) for _, values, truth in evidence]
    share, on_line = (float(np.median(column)) for column in (list(zip(*found, strict=True))[:2]))
    is_declared = "exact" in subject.capabilities
    if not is_declared and on_line < PROVEN:
        raise CheckSkipped(
            "only for a network that returns the ground truth ('exact' in its capabilities)"
        )
    limits = {name: error.exact if is_declared else error.nearly for name, error in ERRORS.items()}
    limits |= subject.exact_limits if is_declared else {}
    if not is_declared and share < PROVEN and subject.interface == "metric_depth":
        limits = {}  # the scale of real depth is an estimate; 'depth_is_in_metres' judges its mean
    wanted = "the truth in all photos, as of a perfect network"
    for (case, _, _), own in zip(evidence, found, strict=True):
        if own.on_line >= PROVEN and abs(own.factor - 1) > MAX_FACTOR:
            got = (
                f"{_line(subject.interface, own)} in {own.on_line:.0%} of the output for the "
                f"photo '{case.name}'"
            )
            raise CheckFailed(
                wanted,
                got,
                "Is it a scale, a unit, a gamma or a mean that the network's authors state?",
            )
    errors = [
        measure_errors(subject.interface, answer, case) for case, answer in subject.evidence()
    ]
    for name, limit in limits.items():
        sign = 1 if ERRORS[name].better == "lower" else -1
        values = {i: sign * row[name] for i, row in enumerate(errors) if name in row}
        worst = max(values, key=lambda i: values[i], default=None)
        if worst is not None and values[worst] > sign * limit:
            (case, own_values, truth), own = evidence[worst], found[worst]
            raise CheckFailed(
                f"{wanted}: {name} of at {'most' if sign > 0 else 'least'} {limit:g}",
                f"{abs(values[worst]):.3g} in the photo '{case.name}', where {own.share:.0%} of "
                f"the output are true; "
                f"{share:.0%} in the median of the photos",
                _explain(subject.interface, table, own_values, truth, own, share),
            )


def _line(interface: str, own: Agreement) -> str:
    """Return the line of an output as text."""
    if interface in ("metric_depth", "relative_pointmap"):
        return f"{np.exp(own.offset):.3g} times the power {own.factor:.3g} of the depth"
    return f"{own.factor:.3g} times the truth, {own.offset:+.2g}"


def _explain(
    interface: str, table: Table, values: Values, truth: Values, own: Agreement, share: float
) -> str:
    """Return what is off in a photo, by how much, and its usual cause."""
    found, true, tolerance = _known(table, values, truth)
    if interface == "contact_prior" and own.on_line >= PROVEN > own.share:
        return (
            f"The values are from {found.min():.2g} to {found.max():.2g}: is a sigmoid applied "
            f"twice, or not at all?"
        )
    largest = found > found.max(initial=-np.inf) - tolerance
    if (
        largest.sum() > MAX_LARGEST * len(largest)
        and (true[largest] > found[largest] + tolerance).any()
    ):
        return (
            f"{largest.mean():.0%} of it are the largest value, and truly larger: is it "
            f"clipped at a limit?"
        )
    if own.share >= PROVEN:
        return (
            "A part is wrong and the rest is right: values that overflow, a border, rows or "
            "people left out?"
        )
    if share >= PROVEN:
        return (
            "Other photos are right: is a photo of this shape turned for the network and back, or "
            "does it depend "
            "on size, aspect ratio, camera or an earlier call?"
        )
    if found.size and found.std() < 1e-6 < true.std():
        return f"It is {found[0]:.3g} everywhere: is the network's answer used?"
    if true.size > 2 and true.std() > 0 and own.on_line < PROVEN:
        factor = float(np.cov(found, true)[0, 1] / true.var(ddof=1))
        own = Agreement(own.share, own.on_line, factor, float(found.mean() - factor * true.mean()))
    return (
        f"It is {_line(interface, own)} in the mean: a factor, a shift, another order, or "
        f"resampling?"
    )


def _known(table: Table, values: Values, truth: Values) -> tuple[FloatArray, FloatArray, float]:
    """Return numbers (K,) of an output and the true ones, and the tolerance of rounding."""
    with np.errstate(all="ignore"):
        own, true, tolerance = table.exact(values, truth)
    own, true = (np.asarray(v, np.float64).ravel() for v in np.broadcast_arrays(own, true))
    known = np.isfinite(own) & np.isfinite(true)
    step = max(1, int(known.sum()) // _SAMPLES)
    return own[known][::step], true[known][::step], tolerance


def agreement(table: Table, values: Values, truth: Values) -> Agreement:
    """Return which share of an output is the truth, or on one line with it."""
    own, true, tolerance = _known(table, values, truth)
    if not own.size:
        return Agreement(0.0, 0.0)
    share = float((np.abs(own - true) < tolerance).mean())
    factor, offset, on_line = (
        _line_of_most(own, true, tolerance) if share < PROVEN else (1.0, 0.0, share)
    )
    return Agreement(share, on_line, factor, offset) if on_line > share else Agreement(share, share)


def _line_of_most(
    own: FloatArray, true: FloatArray, tolerance: float
) -> tuple[float, float, float]:
    """Return factor and offset of the line through two values that most values lie on, and their
    share.
    """
    one, other = np.random.default_rng(0).integers(len(true), size=(2, _LINES))
    gaps = true[one] - true[other]
    factors = (own[one] - own[other]) / np.where(gaps == 0, np.nan, gaps)
    telling = (np.abs(gaps) > 20 * tolerance) & (factors > FACTORS[0]) & (factors < FACTORS[1])
    if not telling.any():
        return 1.0, 0.0, 0.0
    factors = factors[telling]
    offsets = own[one[telling]] - factors * true[one[telling]]
    hits = (np.abs(own - offsets[:, None] - factors[:, None] * true) < tolerance).mean(1)
    best = int(hits.argmax())
    return float(factors[best]), float(offsets[best]), float(hits[best])
