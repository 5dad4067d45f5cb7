"""Probability that a body part touches scene, floor or a hidden support.

What the person observer says of a part decides, at the share of such parts that touch. Of other
feet and buttocks, distance does, by a logistic model. No model of distance tells more of other
parts than their share, which they have.

The shares, the weights, the photos that they were fitted on and the error on photos that took no
part are in ``touch.json``, which ``benchmarks/contact_on_photos.py`` writes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from scipy.special import expit, logit, softmax
from torch import Tensor

from physic_core.engine.body_parts import OBSERVED
from physic_core.types.observations import TOUCH_PARTS, TOUCHED

if TYPE_CHECKING:
    from physic_core.types import FloatArray


def touch_probability(evidence: FloatArray) -> FloatArray:
    """Return the probability (..., 10, 5) that each of ``TOUCH_PARTS`` touches each of ``TOUCHED``
    of :mod:`physic_core.types.observations`, by what an observer says beyond its share (..., 10,
    5); where it says 0, nothing, those of an average part.
    """
    probability: FloatArray = softmax(evidence + np.log(touch_rates()), -1)
    return probability


@cache
def touch_rates() -> FloatArray:
    """Return the share (10, 5) of each of ``TOUCH_PARTS`` that touches each of ``TOUCHED``."""
    rates = [_fitted_numbers()["rates"][part.rpartition("_")[2]] for part in TOUCH_PARTS]
    return np.array([[rate[word] for word in TOUCHED] for rate in rates])


def floor_probability(evidence: FloatArray) -> FloatArray:
    """Return the probability (...) that feet that touch are on the floor, by what an observer says
    beyond its share (...).
    """
    probability: FloatArray = expit(evidence + logit(_fitted_numbers()["floor rate"]))
    return probability


def world_touch_rate(part: str) -> float:
    """Return the share of a body part, such as "left_hand", that touches the world."""
    row = OBSERVED.get(part)
    if row is None:
        return float(_fitted_numbers()["rate of others"])
    return float(touch_rates()[row, TOUCHED.index("world")])


def touch_by_distance(part: str, distance: Tensor) -> Tensor:
    """Return the probability (...) that a body part touches the world, by its distance (...) from
    the nearest surface in standard deviations; its share where distance tells no more.
    """
    model = _fitted_numbers()["parts"].get(part.rpartition("_")[2])
    if model is None:
        return torch.full_like(distance, world_touch_rate(part))
    return torch.sigmoid(model["constant"] + model["distance"] * distance)


@cache
def _fitted_numbers() -> Mapping[str, Any]:
    text = (files("physic_core.engine.ground") / "touch.json").read_text(encoding="utf-8")
    fitted: Mapping[str, Any] = json.loads(text)
    return fitted
