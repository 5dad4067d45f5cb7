"""Touch of body parts, from the picture before people are placed.

What the person observer says of a part decides.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.ground.carriers import NOTHING, Carried
from physic_core.engine.ground.touch import (
    floor_probability,
    touch_probability,
    touch_rates,
)
from physic_core.types.arrays import PER_PERSON
from physic_core.types.observations import LEAST_PROBABILITY, TOUCH_PARTS, TOUCHED
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types import AnyArray, BoolArray, FloatArray, Observations

WORLD = TOUCHED.index("world")
OBJECT = TOUCHED.index("object")
"""Columns of :data:`physic_core.types.TOUCHED`."""

_HANDS = [TOUCH_PARTS.index("left_hand"), TOUCH_PARTS.index("right_hand")]


@dataclass(frozen=True)
class Stance(ShortRepr):
    """Evidence of a picture for the touch of N people; feet and hands are left and right.

    Attributes:
        touch: (N, 10, 5) probability by the person observer that each of :data:`TOUCH_PARTS`
            touches each of :data:`TOUCHED`, at the rates of all labelled people; NaN where it does
            not say.
        on_floor: (N, 2) that left and right foot are on the floor if they touch anything; NaN where
            it does not say.
        stand_probability: (N, 2) that the foot stands on the floor; only a prior if no floor was
            found.
        rest_probability: (N,) that the lowest skin rests on the floor, of people who lie, plank or
            are on all fours; NaN of others.
        carried: what people ride, and boards below their feet; None without any in the picture.
    """

    touch: FloatArray = field(metadata=PER_PERSON)
    on_floor: FloatArray = field(metadata=PER_PERSON)
    stand_probability: FloatArray = field(metadata=PER_PERSON)
    rest_probability: FloatArray = field(metadata=PER_PERSON)
    carried: Carried | None = field(default=None, metadata=PER_PERSON)

    @staticmethod
    def in_picture(observations: Observations) -> Stance:
        """Return the stance of people by what is observed of them; feet of which nothing
        is said are on the floor as often as others that touch.
        """
        touch = touch_probability(observations.evidence("touch"))
        likely = floor_probability(observations.evidence("on_floor"))
        stands = likely * touch[:, :2, WORLD]
        return Stance(
            np.where(np.isnan(observations.touch), np.nan, touch),
            np.where(np.isnan(observations.on_floor), np.nan, likely),
            stands,
            np.full(len(stands), np.nan),
        )

    @staticmethod
    def unknown(count: int) -> Stance:
        """Return the stance of N average people."""
        from physic_core.types import Observations

        return Stance.in_picture(Observations.unknown(count))

    @property
    def limb_touch_probability(self) -> FloatArray:
        """Probability (N, 5) that feet, hands and seat touch floor, seat or support."""
        return self._likely_touch[:, :5, WORLD]

    @property
    def _likely_touch(self) -> FloatArray:
        """``touch`` (N, 10, 5), the rates of all people where the observer does not say."""
        return np.where(np.isnan(self.touch), touch_rates(), self.touch)

    @property
    def holds(self) -> BoolArray:
        """Left and right hands (N, 2) bool that probably hold something."""
        return self.touch[:, _HANDS, OBJECT] > LEAST_PROBABILITY

    @property
    def stands_on_both_feet(self) -> BoolArray:
        """People (N,) bool with both feet probably on the floor."""
        return np.asarray((self.stand_probability >= LEAST_PROBABILITY).all(1))

    def with_resting(self, limbs: BoolArray) -> Stance:
        """Return the stance of people whose feet and hands (N, 4) lie lowest: where the lowest skin
        probably rests, these touch by what is seen of them, or else by that; not hands that hold
        something, which may be a bar.
        """
        likely_touch = self._likely_touch[:, :4]
        world = likely_touch[..., WORLD]
        lifted = (1 - world) * (1 - self.rest_probability[:, None])
        rests = limbs & (self.rest_probability >= LEAST_PROBABILITY)[:, None]
        rests[:, 2:] &= ~self.holds
        likely_touch = likely_touch * (lifted / (1 - world))[..., None]
        likely_touch[..., WORLD] = 1 - lifted
        touch = self.touch.copy()
        touch[:, :4] = np.where(rests[..., None], likely_touch, touch[:, :4])
        return replace(self, touch=touch)

    def expanded(self, rows: BoolArray) -> Stance:
        """Return N rows from those of the people selected by ``rows`` (N,); the others have average
        feet.
        """

        def wider(array: AnyArray, empty: FloatArray | float = np.nan) -> AnyArray:
            wide = np.full((len(rows), *array.shape[1:]), empty, array.dtype)
            wide[rows] = array
            return wide

        stands = wider(self.stand_probability, Stance.unknown(1).stand_probability[0])
        carried = self.carried and replace(
            self.carried,
            ridden=wider(self.carried.ridden, NOTHING),
            board=wider(self.carried.board, NOTHING),
        )
        rests = wider(self.rest_probability)
        return Stance(wider(self.touch), wider(self.on_floor), stands, rests, carried)
