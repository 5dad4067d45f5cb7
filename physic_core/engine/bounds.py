"""Number types of settings, with their bounds as annotations for validation and schemas."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Interval

__all__ = [
    "Count",
    "Degrees",
    "NearestStrategy",
    "NotNegative",
    "Positive",
    "PositiveCount",
    "PositiveOrInfinite",
    "RobustKind",
    "Share",
]

# Bounds are part of the field's type: config readers check values without a separate list of names.
Positive = Annotated[float, Interval(gt=0, lt=math.inf)]
PositiveOrInfinite = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Interval(ge=0, lt=math.inf)]
Share = Annotated[float, Interval(ge=0, le=1)]
Degrees = Annotated[float, Interval(gt=0, le=180)]
Count = Annotated[int, Ge(0)]
PositiveCount = Annotated[int, Gt(0)]
RobustKind = Literal["square", "absolute", "pseudo_huber", "cauchy", "geman_mcclure", "barron"]
NearestStrategy = Literal["kdtree", "grid", "brute"]
