"""Probability that a body part touches scene, floor or a hidden support.

What the person observer says of a part decides, at the share of such parts that touch. Of the
others, distance does: one logistic model for each kind of part. A feature is a reason for or
against contact.

The shares, the weights, the photos that they were fitted on and the error on photos that took no
part are in ``touch.json``, which ``benchmarks/contact_on_photos.py`` writes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

DISTANCE = "distance"
"""Feature of feet, hands and seat: their distance from the nearest surface, in standard
deviations.
"""

LEAST_PROBABILITY = 0.5
"""Minimum probability of a part in contact: others are not listed and do not support the person."""

LIES = "lies"
"""Feature of other parts: 1 if the trunk is nearly horizontal."""

CARRIES = "carries"
"""Feature of other parts: how near the surface is, 1 at it and 0 from a standard deviation on,
times the cosine between down and the skin that is nearest to it.
"""

SKIN = "skin"
"""Kind of contact of a part with another person or the own body."""

OUTSIDE = "outside"
"""Feature of skin: log(1 + d / 1 cm) of the distance of a part from the other one."""

INSIDE = "inside"
"""Feature of skin: the same of the depth of the part within the other one."""

HAND = "hand"
"""Feature of skin: 1 if one of both parts is a hand."""

OWN_BODY = "own body"
"""Feature of skin: 1 if both parts are of one body."""

Values = TypeVar("Values", NDArray[np.floating[Any]], Tensor)


def observed_log_odds(kind: str, beyond: Values) -> Values:
    """Return the log odds (...) that parts touch, by those that an observer says beyond its share;
    where it says 0, nothing, those of an average part.

    Args:
        kind: "foot", "hand" or "seat"; "object" for what hands hold; "floor" for feet that touch.
        beyond: (...).
    """
    share = _fitted()["shares"][kind]
    found: Values = beyond + math.log(share / (1 - share))
    return found


def touch_log_odds(kind: str, features: Mapping[str, Values]) -> Values:
    """Return the log odds (...) that parts touch.

    Args:
        kind: of the parts: "foot", "hand", "seat", "other"; :data:`SKIN` for contact of a part with
            another person or the own body.
        features: name -> values (...), more than the kind needs or as many.

    Raises:
        KeyError: a feature is missing.
    """
    constant, *weights = touch_model()[kind].items()
    odds: Any = constant[1]
    for name, weight in weights:
        odds = odds + weight * features[name]
    found: Values = odds
    return found


def touch_model() -> Mapping[str, Mapping[str, float]]:
    """Return kind of part -> "constant" and names of features -> weight."""
    parts: Mapping[str, Mapping[str, float]] = _fitted()["parts"]
    return parts


@cache
def _fitted() -> Mapping[str, Any]:
    text = (files("physic_core.engine.ground") / "touch.json").read_text(encoding="utf-8")
    fitted: Mapping[str, Any] = json.loads(text)
    return fitted
