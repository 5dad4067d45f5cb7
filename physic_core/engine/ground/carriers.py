"""What carries whom: the bicycle, motorcycle or horse that a person rides, and the board under both
feet, by boxes and keypoints in the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types.arrays import PER_PERSON
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Carrier, FloatArray, IntArray, Keypoints

RIDDEN = ("bicycle", "motorcycle", "horse")
"""Carriers that people sit on; people stand on the others."""

NOTHING = -1
"""Entry of :class:`Carried` for a person without a carrier."""

# Set on 52 labelled photos with such boxes; no other photos have tested them. The unit is the
# length from shoulders to hips in the picture.
_ABOVE = 0.5  # hips over the upper edge of what a person rides
_BELOW = 0.5  # least height of its box below the hips
_BESIDE_HIPS = 0.2  # reach beside the hips in which a person rides a box
_BESIDE_FEET = 0.3  # reach beside the feet in which a board carries a person


@dataclass(frozen=True)
class Carried(ShortRepr):
    """Carriers of N people, as indices into ``names``; :data:`NOTHING` without one.

    Attributes:
        names: of all carriers in the picture.
        ridden: (N,) int, what the person probably sits on.
        board: (N,) int, board below both feet.
    """

    names: tuple[str, ...]
    ridden: IntArray = field(metadata=PER_PERSON)
    board: IntArray = field(metadata=PER_PERSON)

    @property
    def rides(self) -> BoolArray:
        """People (N,) bool on a bicycle, a motorcycle or a horse."""
        return np.asarray(self.ridden != NOTHING)


def carried_people(carriers: Sequence[Carrier], keypoints: Keypoints) -> Carried:
    """Find what carries each of N people.

    A person rides what has the hips within its sides, not far above it, and reaches below them. A
    board carries a person if its box, with a margin, holds the keypoints of both feet: boxes around
    one foot are mostly shoes. Of several the detection with the highest score counts.

    Args:
        carriers: in the picture.
        keypoints: of the people.
    """
    names = tuple(one.name for one in carriers)
    rows = {name: j for j, name in enumerate(keypoints.joint_set.names)}
    points = np.asarray(keypoints.points, np.float64)

    def pair_values(*ends: str) -> FloatArray:
        columns = [
            rows[name] for end in ends for side in SIDES if (name := f"{side}_{end}") in rows
        ]
        return points[:, columns] if columns else np.full((len(points), 1, 2), np.nan)

    hips = pair_values("hip").mean(1)
    trunk = np.linalg.norm(pair_values("shoulder").mean(1) - hips, axis=1)
    x, y = np.moveaxis(pair_values("ankle", "heel", "foot_tip", "big_toe"), -1, 0)
    ridden = np.full(len(points), NOTHING)
    board = ridden.copy()
    for k in sorted(range(len(carriers)), key=lambda k: carriers[k].score):
        x0, y0, x1, y1 = carriers[k].box
        if names[k] in RIDDEN:
            beside = _BESIDE_HIPS * trunk
            within = (hips[:, 0] > x0 - beside) & (hips[:, 0] < x1 + beside)
            over = (hips[:, 1] > y0 - _ABOVE * trunk) & (y1 - hips[:, 1] > _BELOW * trunk)
            ridden[within & over] = k
        else:
            margin = _BESIDE_FEET * trunk[:, None]
            across = (x > x0 - margin) & (x < x1 + margin)
            down = (y > y0 - margin) & (y < y1 + margin)
            board[(across & down).all(1)] = k
    return Carried(names, ridden, board)
