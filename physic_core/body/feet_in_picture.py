"""Which feet touch something, by the keypoints of the legs in the picture alone.

A raised foot of a runner looks like a foot on the floor farther away: a fit that is told that feet are level makes it
one. What the picture says of a foot is therefore asked first: how much higher it is than the other one, how far its
heel is over its toes, and how long and how bent the other leg looks. The logistic model lies in
``feet_in_picture.json``, with the photos that it was fitted on and its error on photos that took no part.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating[Any]]

_TOES = ("foot_tip", "big_toe")
_MOST_TRUNKS = 1.0  # a foot that is still higher says no more


@dataclass(frozen=True)
class _FootModel:
    """Coefficients of the log odds that a foot touches something, and the mean of each feature."""

    constant: float
    weights: tuple[float, ...]
    means: tuple[float, ...]


def foot_touch_probability(points: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the probability that the left and the right foot touch floor, seat or support, (N, 2).

    People without finite keypoints of both legs get the probability of an average foot.

    Args:
        points: (N, J, 2) px; y points down.
        names: of the J keypoints, such as "left_heel".
    """
    model, count = _model(), len(points)
    features = foot_features(points, names)
    odds = np.full((count, 2), model.constant)
    for mean, weight, column in zip(model.means, model.weights, np.moveaxis(features, -1, 0), strict=True):
        odds += weight * (np.where(np.isfinite(column), column, mean) - mean)
    return np.asarray(1 / (1 + np.exp(-odds)))


def foot_features(points: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the features (N, 2, 4) of the left and the right foot; NaN without both legs.

    In lengths of the trunk in the picture: how much lower the foot is than the other one, how far the heel is below the
    toes, and the length of the other shin; then the bend of the other knee in radians.
    """
    row = {name: j for j, name in enumerate(names)}
    toe = next((name for name in _TOES if f"left_{name}" in row), "")
    used = [f"{side}_{part}" for side in SIDES for part in ("shoulder", "hip", "knee", "ankle", "heel", toe)]
    count = len(points)
    if not all(name in row for name in used) or not count:
        return np.full((count, 2, 4), np.nan)
    at = {name: np.asarray(points[:, row[name]], np.float64) for name in used}
    shoulders, hips = ((at[f"left_{name}"] + at[f"right_{name}"]) / 2 for name in ("shoulder", "hip"))
    trunk = np.linalg.norm(shoulders - hips, axis=-1)
    lowest, shin, bend = [], [], []
    for side in SIDES:
        lowest.append(np.max([at[f"{side}_{part}"][:, 1] for part in ("ankle", "heel", toe)], axis=0))
        lower, upper = (at[f"{side}_{a}"] - at[f"{side}_{b}"] for a, b in (("ankle", "knee"), ("knee", "hip")))
        shin.append(np.linalg.norm(lower, axis=-1))
        cosine = (lower * upper).sum(-1) / np.maximum(shin[-1] * np.linalg.norm(upper, axis=-1), 1e-9)
        bend.append(np.arccos(np.clip(cosine, -1, 1)))
    found = []
    with np.errstate(divide="ignore", invalid="ignore"):
        for own, other in ((0, 1), (1, 0)):
            lower = np.clip((lowest[own] - lowest[other]) / trunk, -_MOST_TRUNKS, _MOST_TRUNKS)
            heel = (at[f"{SIDES[own]}_heel"][:, 1] - at[f"{SIDES[own]}_{toe}"][:, 1]) / trunk
            found.append(np.stack([lower, heel, shin[other] / trunk, bend[other]], -1))
    features = np.stack(found, 1)
    return np.where(np.isfinite(features).all((1, 2), keepdims=True), features, np.nan)


@cache
def _model() -> _FootModel:
    text = (files("physic_core.body") / "feet_in_picture.json").read_text(encoding="utf-8")
    record = json.loads(text)
    features = record["features"].values()
    return _FootModel(record["constant"], tuple(f["weight"] for f in features), tuple(f["mean"] for f in features))
