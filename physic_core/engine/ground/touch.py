"""Probability that a body part touches scene, floor or a hidden support: one logistic model for
each kind of part.

The weights, the photos that they were fitted on and the error on photos that took no part are in
``touch.json``, which ``benchmarks/contact_on_photos.py`` writes. A feature is a reason for or
against contact, and 0 where nothing is known of it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

DISTANCE = "distance"
"""Feature of all kinds: the distance of the part from the nearest surface, in its standard
deviations.
"""

LEAST_PROBABILITY = 0.5
"""Minimum probability of a part in contact: others are not listed and do not support the person."""

LOWER = "lower than the other foot"
"""Feature of feet in the picture: how much lower than the other one, in lengths of the trunk."""

OBSERVED = "observed"
"""Feature of feet, hands and seat: log odds by the person observer, beyond its base rate."""

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

HANDS = "hands"
"""Feature of unseen feet: the larger probability that a hand touches the world; 0 for people who
ride.
"""

Values = TypeVar("Values", NDArray[np.floating[Any]], Tensor)


def touch_log_odds(kind: str, features: Mapping[str, Values]) -> Values:
    """Return the log odds (...) that parts touch; one number for a kind without features.

    Args:
        kind: of the parts: "foot", "hand", "seat" or "other"; "foot in the picture" and so on
            before people are placed; "unseen foot" and so on if no pixel shows the part;
            :data:`SKIN` for contact of a part with another person or the own body.
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


@cache
def touch_model() -> Mapping[str, Mapping[str, float]]:
    """Return kind of part -> "constant" and names of features -> weight."""
    text = (files("physic_core.engine.ground") / "touch.json").read_text(encoding="utf-8")
    parts: Mapping[str, Mapping[str, float]] = json.loads(text)["parts"]
    return parts
