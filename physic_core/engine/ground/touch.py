"""Probability that a body part touches scene, floor or a hidden support.

What the person observer says of a part decides, at the share of such parts that touch. Of the
others, distance does: one logistic model for each kind of part. A feature is a reason for or
against contact.

The shares, the weights, the photos that they were fitted on and the error on photos that took no
part are in ``touch.json``, which ``benchmarks/contact_on_photos.py`` writes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit, softmax
from torch import Tensor

from physic_core.types.observations import TOUCH_PARTS, TOUCHED

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

FloatArray = NDArray[np.floating[Any]]
Values = TypeVar("Values", NDArray[np.floating[Any]], Tensor)


def touch_probability(evidence: FloatArray) -> FloatArray:
    """Return the probability (..., 10, 5) that each of ``TOUCH_PARTS`` touches each of ``TOUCHED``
    of :mod:`physic_core.types.observations`, by what an observer says beyond its share (..., 10,
    5); where it says 0, nothing, those of an average part.
    """
    found: FloatArray = softmax(evidence + np.log(usual_touch()), -1)
    return found


@cache
def usual_touch() -> FloatArray:
    """Return the share (10, 5) of each of ``TOUCH_PARTS`` that touches each of ``TOUCHED``."""
    rates = [_fitted()["rates"][part.rpartition("_")[2]] for part in TOUCH_PARTS]
    return np.array([[rate[word] for word in TOUCHED] for rate in rates])


def floor_probability(evidence: FloatArray) -> FloatArray:
    """Return the probability (...) that feet that touch are on the floor, by what an observer says
    beyond its share (...).
    """
    found: FloatArray = expit(evidence + logit(_fitted()["floor rate"]))
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
