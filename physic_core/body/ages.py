"""Statures and shapes of children by age, fitted to Anny's calibrated distribution (``tools/bake_children.py``)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray

ADULT_YEARS = 16.0
"""Age from which the body estimator's prior of adults holds."""


@dataclass(frozen=True)
class AgeClasses:
    """Children from birth to :data:`ADULT_YEARS` in C classes of age.

    Attributes:
        years: (C, 2) limits of each class.
        log_stature: (C,) mean of the logarithm of stature in metres.
        sigma: (C,) standard deviation of it.
        shape: (D, K) polynomial of log stature that gives the mean betas of the embedded body, constant term first.
    """

    years: FloatArray
    log_stature: FloatArray
    sigma: FloatArray
    shape: FloatArray

    @property
    def middle(self) -> FloatArray:
        """Mean age (C,) of each class, years."""
        middle: FloatArray = self.years.mean(1)
        return middle

    def at_age(self, years: float) -> tuple[float, float]:
        """Return mean and standard deviation of log stature at an age below :data:`ADULT_YEARS`."""
        mean, sigma = (np.interp(years, self.middle, values) for values in (self.log_stature, self.sigma))
        return float(mean), float(sigma)

    def betas(self, log_stature: FloatArray) -> FloatArray:
        """Return the mean betas (N, K) of children with the logarithms (N,) of stature."""
        betas: FloatArray = np.polynomial.polynomial.polyval(np.asarray(log_stature), self.shape).T
        return betas


@cache
def load_ages() -> AgeClasses:
    """Return the fitted classes of age."""
    fitted = json.loads(Path(__file__).with_name("ages.json").read_text(encoding="utf-8"))
    stature = np.array([row["log_stature"] for row in fitted["classes"]])
    return AgeClasses(
        years=np.array([row["years"] for row in fitted["classes"]], np.float64),
        log_stature=stature[:, 0],
        sigma=stature[:, 1],
        shape=np.array(fitted["betas_by_log_stature"]),
    )
