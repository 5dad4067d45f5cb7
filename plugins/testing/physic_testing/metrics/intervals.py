"""Figures with 95 % bootstrap intervals over independent groups, such as photos, films or worlds.

People of one photo share its scene and scale: groups are resampled, not people. The interval is the
percentile bootstrap of Efron and Tibshirani (1993).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_Item = TypeVar("_Item")

DRAWS = 2000
"""Number of bootstrap draws."""

_SEED = 20261121


@dataclass(frozen=True)
class ValueWithInterval:
    """A number with its 95 % interval; NaN where it is unknown.

    Attributes:
        value: over all items.
        low: lower end of the interval.
        high: upper end of the interval.
        count: number of items with a value.
        groups: number of independent groups; 0 if it is not stated.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    count: int = 0
    groups: int = 0


def draw_counts(groups: int, draws: int = DRAWS) -> FloatArray:
    """Return how often each group is drawn: (draws, G) float64, the same for the same arguments."""
    rng = np.random.default_rng(_SEED)
    return rng.multinomial(groups, np.full(groups, 1 / max(groups, 1)), draws).astype(np.float64)


def percentile_interval(values: FloatArray | Sequence[float]) -> tuple[float, float]:
    """Return the 2.5th and the 97.5th percentile of the finite draws of a figure; NaN without
    one.
    """
    finite = np.asarray(values, np.float64)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return math.nan, math.nan
    low, high = np.percentile(finite, [2.5, 97.5])
    return float(low), float(high)


def resampled_interval(
    strata: Sequence[Sequence[_Item]],
    statistic: Callable[[list[list[_Item]]], float],
    draws: int = DRAWS,
) -> tuple[float, float]:
    """Return the interval of a statistic whose groups are drawn anew within each stratum, with
    replacement.

    Args:
        strata: the groups of each stratum, such as the films of each data set.
        statistic: computes the figure from the groups that were drawn.
        draws: number of draws.

    Returns:
        NaN for fewer than two groups in a stratum, and without strata.
    """
    if min((len(stratum) for stratum in strata), default=0) < 2:
        return math.nan, math.nan
    rng = np.random.default_rng(_SEED)
    return percentile_interval(
        [
            statistic([[s[k] for k in rng.integers(len(s), size=len(s))] for s in strata])
            for _ in range(draws)
        ]
    )


def aligned_table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of equal length as lines: the first column on the left, numbers on the right of
    theirs.
    """
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(
            [
                row[0].ljust(widths[0]),
                *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)),
            ]
        ).rstrip()
        for row in rows
    )


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of equal length as Markdown."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|---|" + "---:|" * (len(rows[0]) - 1), *lines[1:]])
