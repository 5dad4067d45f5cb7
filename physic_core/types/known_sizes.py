"""Sizes that the user knows: statures, ages, the camera's height, and lengths between two
pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from physic_core.types.arrays import PER_PERSON
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray

_STATURES_M = (0.4, 1.7, 2.6)  # least, usual and most
_HEIGHTS_M = (0.01, 1.6, 100)  # the same of a camera over the floor
_LENGTHS_M = (0.01, 1.0, 1000)  # the same of a known length
_OLDEST = 120.0  # years
_UNITS_M = {"cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}


@dataclass(frozen=True)
class KnownLength:
    """True distance between the points that two pixels show, on the scene or on a person.

    Attributes:
        start: (x, y) px.
        end: (x, y) px.
        metres: distance between the two points.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    metres: float


@dataclass(frozen=True)
class KnownSizes:
    """Sizes that the user knows, in meters; they override the estimates.

    Attributes:
        stature: standing heights: one for all people, or one per person, 0 where unknown; empty if
            none is known. The order is that of the chosen people (points, boxes, masks), and
            without a choice from left to right in the photo (by the center of the box).
        camera_height: of the camera over the floor; None if unknown.
        lengths: distances between pixels.
        age: years, as ``stature``: one for all people, or one per person, 0 where unknown. A child
            of known age and unknown stature has the usual stature of that age.

    Raises:
        ValueError: a stature is not 0.4 to 2.6 m, a camera height 0.01 to 100 m, a length 0.01 to
            1000 m, or an age 0 to 120 years; a length has no extent in px; or statures or ages are
            one number. The message states the likely unit.
    """

    stature: tuple[float, ...] = ()
    camera_height: float | None = None
    lengths: tuple[KnownLength, ...] = ()
    age: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("stature", "age"):
            if isinstance(value := getattr(self, name), int | float):
                raise ValueError(f"{name} is a tuple, one value for each person: ({value:g},)")
        comma = "; a comma separates people: write 1.7" if len(self.stature) > 1 else ""
        for height in self.stature:
            if height != 0:
                _check("a stature", height, _STATURES_M, f", or 0 where unknown{comma}")
        for years in self.age:
            if not 0 <= years <= _OLDEST:
                raise ValueError(
                    f"an age should be 0 to {_OLDEST:g} years, 0 where unknown (got {years:g})"
                )
        if self.camera_height is not None:
            _check("the camera height", self.camera_height, _HEIGHTS_M)
        for length in self.lengths:
            _check("a known length", length.metres, _LENGTHS_M)
            if (
                not all(map(math.isfinite, (*length.start, *length.end)))
                or math.dist(length.start, length.end) < 1
            ):
                raise ValueError(
                    f"a known length needs two different pixels (got {length.start} and "
                    f"{length.end})"
                )

    def __bool__(self) -> bool:
        return bool(
            any(self.stature) or any(self.age) or self.camera_height is not None or self.lengths
        )


@dataclass(frozen=True)
class KnownPeople(ShortRepr):
    """What the user knows about N people of a photo.

    Attributes:
        years: (N,) ages, NaN where unknown; None if none is known.
        stature: (N,) meters, NaN where unknown; None if none is known.
    """

    years: FloatArray | None = field(default=None, metadata=PER_PERSON)
    stature: FloatArray | None = field(default=None, metadata=PER_PERSON)

    def filled(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return statures and years (N,) of N people, NaN where unknown."""
        import numpy as np

        unknown = np.full(count, np.nan)
        return (
            unknown if self.stature is None else self.stature,
            unknown if self.years is None else self.years,
        )


def size_option(option: str, people: int) -> str:
    """Return how the command line takes a size that is known of some of the people."""
    return option if people == 1 else f"{option},... (left to right, 0 where unknown)"


def _check(what: str, size: float, metres: tuple[float, float, float], unknown: str = "") -> None:
    """Raise ValueError if a size is not between the least and the most; the message states the unit
    in which it is nearest to a usual one.
    """
    least, usual, most = metres
    if least <= size <= most:
        return
    likely = {u: size * m for u, m in _UNITS_M.items() if least <= size * m <= most}
    hint = ""
    if likely:
        unit = min(likely, key=lambda unit: abs(math.log(likely[unit] / usual)))
        hint = f"; {size:g} {unit} are {likely[unit]:.3g} meters"
    raise ValueError(f"{what} should be {least} to {most} meters{unknown} (got {size:g}{hint})")
