"""Who is upright, by the picture and the person observer: of these people alone it is asked how far
they lean.

Each witness can be wrong alone. The observer calls people who lie "sit" or "stand", and the trunk
of a person who lies away from the camera points up in the picture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.types.observations import POSTURES
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import BoolArray, FloatArray, Keypoints, Observations

_UPRIGHT_POSTURES = ("stand", "walk", "run", "sit", "ride")
_LEAST_UPRIGHT = 0.5  # probability of these postures together
_UPRIGHT_DEG = 45.0  # largest angle of an upright trunk from up in the picture


def upright_people(keypoints: Keypoints, said: Observations) -> BoolArray:
    """Return who of N people is upright (N,), unless picture or observer says otherwise.

    Args:
        keypoints: of the people.
        said: of the same people.
    """
    axis = trunk_in_picture_deg(keypoints.points, keypoints.joint_set.names)
    postures = [POSTURES.index(name) for name in _UPRIGHT_POSTURES]
    likely = said.posture[:, postures].sum(1)
    return np.asarray(~(np.abs(axis) > _UPRIGHT_DEG) & ~(likely < _LEAST_UPRIGHT))


def trunk_in_picture_deg(points: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the angle (N,) from up in the picture to the line from hips to shoulders, degrees in
    (-180, 180], clockwise; NaN where a joint is unknown.

    Args:
        points: (N, J, 2) px; y points down.
        names: of the J keypoints.
    """
    columns = {name: j for j, name in enumerate(names)}
    unknown = np.full((len(points), 2), np.nan)

    def middle(joint: str) -> FloatArray:
        ends = [columns.get(f"{side}_{joint}") for side in SIDES]
        both = [unknown if j is None else points[:, j] for j in ends]
        return np.asarray(np.mean(both, axis=0, dtype=np.float64))

    trunk = middle("shoulder") - middle("hip")
    return np.asarray(np.degrees(np.arctan2(trunk[:, 0], -trunk[:, 1])))
