"""What an observer says of the parts of one person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from physic_core.types import TOUCH_PARTS, TOUCHED, Observations

LIMBS = TOUCH_PARTS[:5]


def touching(**parts):
    """Probabilities (1, 10, 5) by part -> (what it touches, probability); of the rest nothing,
    and NaN of parts that are not named.
    """
    touch = np.full((1, len(TOUCH_PARTS), len(TOUCHED)), np.nan)
    for part, (touched, probability) in parts.items():
        row = touch[0, TOUCH_PARTS.index(part)]
        row[:] = 0.0
        row[TOUCHED.index("nothing")] = 1 - probability
        row[TOUCHED.index(touched)] = probability
    return touch


def with_touch(state, **parts):
    """The state of one person, of whose parts the observer says these."""
    return replace(state, observed_touch=torch.tensor(touching(**parts)))


def observations(**parts):
    """Observations of one person, by an observer for whom all answers are equally frequent."""
    share = np.full((len(TOUCH_PARTS), len(TOUCHED)), 1 / len(TOUCHED), np.float32)
    touch = touching(**parts).astype(np.float32)
    return replace(Observations.unknown(1), touch=touch, touch_share=share)
