"""Touch of feet, hands and seat, from the picture before people are placed.

What the person observer says of a part decides.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.engine.ground.carriers import NOTHING, Carried
from physic_core.engine.ground.touch import LEAST_PROBABILITY, observed_log_odds
from physic_core.types.arrays import PER_PERSON
from physic_core.types.observations import TOUCH_PARTS
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, Observations

OBSERVED_COLUMNS = (*TOUCH_PARTS, "left_object", "right_object", "left_floor", "right_floor")
"""Columns of ``log_odds`` of :class:`Stance`: touch of the world by each part, hands that hold an
object, and feet that are on the floor if they touch anything.
"""


@dataclass(frozen=True)
class Stance(ShortRepr):
    """Evidence of a picture for the touch of N people; feet and hands are left and right.

    Attributes:
        log_odds: (N, 9) log odds by the person observer of each of :data:`OBSERVED_COLUMNS`, beyond
            those of its base rate; 0 where unknown.
        stand_probability: (N, 2) that the foot stands on the floor; only a prior if no floor was
            found.
        rest_probability: (N,) that the lowest skin rests on the floor, of people who lie, plank or
            are on all fours; NaN of others.
        carried: what people ride, and boards below their feet; None without any in the picture.
    """

    log_odds: FloatArray = field(metadata=PER_PERSON)
    stand_probability: FloatArray = field(metadata=PER_PERSON)
    rest_probability: FloatArray = field(metadata=PER_PERSON)
    carried: Carried | None = field(default=None, metadata=PER_PERSON)

    @staticmethod
    def in_picture(observations: Observations) -> Stance:
        """Return the stance of people by what is observed of them; feet of which nothing
        is said are on the floor as often as others that touch.
        """
        parts = [observations.evidence(name) for name in ("touch", "holds", "on_floor")]
        count = len(parts[0])
        stance = Stance(np.concatenate(parts, 1), np.zeros((count, 2)), np.full(count, np.nan))
        on_floor = _probability(observed_log_odds("floor", stance.log_odds[:, _both("floor")]))
        return replace(stance, stand_probability=on_floor * stance.limb_touch_probability[:, :2])

    @staticmethod
    def unknown(count: int) -> Stance:
        """Return the stance of N average people."""
        from physic_core.types import Observations

        return Stance.in_picture(Observations.unknown(count))

    @property
    def limb_touch_probability(self) -> FloatArray:
        """Probability (N, 5) that feet, hands and seat touch floor, seat or support."""
        odds = [
            observed_log_odds(kind, self.log_odds[:, own])
            for kind, own in (
                ("foot", _both("foot")),
                ("hand", _both("hand")),
                ("seat", [OBSERVED_COLUMNS.index("seat")]),
            )
        ]
        return _probability(np.concatenate(odds, 1))

    @property
    def holds(self) -> BoolArray:
        """Left and right hands (N, 2) bool that probably hold something."""
        return np.asarray(observed_log_odds("object", self.log_odds[:, _both("object")]) > 0)

    @property
    def stands_on_both_feet(self) -> BoolArray:
        """People (N,) bool with both feet probably on the floor."""
        return np.asarray((self.stand_probability >= LEAST_PROBABILITY).all(1))

    def with_resting(self, limbs: BoolArray) -> Stance:
        """Return the stance of people whose feet and hands (N, 4) lie lowest: where the lowest skin
        probably rests, these touch by what is seen of them, or else by that; not hands that hold
        something, which may be a bar.
        """
        lifted = (1 - self.limb_touch_probability[:, :4]) * (1 - self.rest_probability[:, None])
        usual = replace(self, log_odds=np.zeros_like(self.log_odds)).limb_touch_probability[:, :4]
        odds = np.log1p(-lifted) - np.log(lifted) - np.log(usual) + np.log1p(-usual)
        observed = self.log_odds.copy()
        rests = limbs & (self.rest_probability >= LEAST_PROBABILITY)[:, None]
        rests[:, 2:] &= ~self.holds
        observed[:, :4] = np.where(rests, odds, observed[:, :4])
        return replace(self, log_odds=observed)

    def expanded(self, rows: BoolArray) -> Stance:
        """Return N rows from those of the people selected by ``rows`` (N,); the others have average
        feet.
        """

        def wider(array: NDArray[Any], empty: FloatArray | float = np.nan) -> NDArray[Any]:
            found = np.full((len(rows), *array.shape[1:]), empty, array.dtype)
            found[rows] = array
            return found

        stands = wider(self.stand_probability, Stance.unknown(1).stand_probability[0])
        carried = self.carried and replace(
            self.carried,
            ridden=wider(self.carried.ridden, NOTHING),
            board=wider(self.carried.board, NOTHING),
        )
        return Stance(wider(self.log_odds, 0.0), stands, wider(self.rest_probability), carried)


def _both(name: str) -> list[int]:
    """Return the columns of :data:`OBSERVED_COLUMNS` of the left and the right side."""
    return [OBSERVED_COLUMNS.index(f"{side}_{name}") for side in SIDES]


def _probability(log_odds: FloatArray) -> FloatArray:
    return np.asarray(1 / (1 + np.exp(-log_odds)))
