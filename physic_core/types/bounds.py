"""Number types of settings, with their bounds as annotations for validation and schemas."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, Interval, MaxLen

# At both ends, squares, quotients of two settings and their sums stay within float32.
_LEAST = 1e-6
Positive = Annotated[float, Interval(ge=_LEAST, le=1 / _LEAST)]
PositiveOrInfinite = Annotated[float, Ge(_LEAST)]
NotNegative = Annotated[float, Interval(ge=0, le=1e8)]
Share = Annotated[float, Interval(ge=0, le=1)]
Degrees = Annotated[float, Interval(ge=_LEAST, le=180)]
# Every preset has converged after 1,000 steps; the largest number takes minutes.
_MOST_STEPS = 2000
Count = Annotated[int, Interval(ge=0, le=_MOST_STEPS)]
PositiveCount = Annotated[int, Interval(ge=1, le=_MOST_STEPS)]
PointCount = Annotated[int, Interval(ge=50, le=100_000)]
FrozenGroups = Annotated[
    tuple[Literal["root", "pose", "hands", "betas", "translation", "scale", "offset"], ...],
    MaxLen(7),
]
