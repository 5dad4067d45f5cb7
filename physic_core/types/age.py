"""Ages of people, estimated or given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray

__all__ = ["AgeEstimate", "AgeEstimates"]


@dataclass(frozen=True)
class AgeEstimate:
    """Whether a person is a child, how old, and how sure their stature is.

    Attributes:
        child_probability: that the person is under 16 years old, in [0, 1].
        years: mean age of a person who was taken for a child; None for an adult.
        years_sigma: its standard deviation, 0 for a given age; None for an adult.
        stature_sigma: standard deviation of the logarithm of the person's stature.
    """

    child_probability: float
    years: float | None
    years_sigma: float | None
    stature_sigma: float


@dataclass(frozen=True)
class AgeEstimates(ShortRepr):
    """Ages and statures of N people.

    Attributes:
        child_probability: (N,) NaN for people without a body.
        years: (N,) mean age of people who are more likely children than adults; NaN for adults.
        years_sigma: (N,) its standard deviation.
        stature: (N,) metres, of children; NaN for adults, whose stature is the estimated one.
        stature_sigma: (N,) standard deviation of the logarithm of stature about the one taken.
    """

    child_probability: FloatArray
    years: FloatArray
    years_sigma: FloatArray
    stature: FloatArray
    stature_sigma: FloatArray

    def notes(self) -> list[str]:
        """Return a sentence about each child."""
        return [
            f"person {i} is {'' if sigma == 0 else 'probably '}a child of "
            f"{f'{years:g}' if sigma == 0 else f'{years:.0f} ± {sigma:.0f}'} years, "
            f"{stature:.2f} m tall before the joint fit"
            for i, (years, sigma, stature) in enumerate(zip(self.years, self.years_sigma, self.stature, strict=True))
            if math.isfinite(years)
        ]

    def scale_guess(self) -> str:
        """Return a warning that the scale is a guess if all people are children of estimated age; else ""."""
        people = [i for i, probability in enumerate(self.child_probability) if not math.isnan(probability)]
        if not people or not all(self.years_sigma[i] > 0 for i in people):
            return ""
        return (
            f"the scale is a guess, since the photo shows only children: statures are uncertain by "
            f"{100 * min(self.stature_sigma[i] for i in people):.0f} %; give an age, a stature or the camera height"
        )

    def person(self, i: int) -> AgeEstimate | None:
        """Return the age of person i; None without a body."""
        if math.isnan(self.child_probability[i]):
            return None
        child = math.isfinite(self.years[i])
        return AgeEstimate(
            child_probability=float(self.child_probability[i]),
            years=float(self.years[i]) if child else None,
            years_sigma=float(self.years_sigma[i]) if child else None,
            stature_sigma=float(self.stature_sigma[i]),
        )
