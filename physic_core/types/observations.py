"""What a network sees of people beside their joints: posture, touch, age, and which way trunk and
face look.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from physic_core.types.arrays import per_person, shape, with_columns
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import mirrored_order

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray, FloatArray

POSTURES = ("stand", "walk", "run", "sit", "squat", "kneel", "lie", "jump", "ride")
"""Columns of ``posture`` of :class:`Observations`."""

LEAST_PROBABILITY = 0.5
"""Probability from which on a statement about a person counts as true."""

TOUCH_PARTS = (
    *("left_foot", "right_foot", "left_hand", "right_hand", "seat"),
    *("left_knee", "right_knee", "left_forearm", "right_forearm", "back"),
)
"""Rows of ``touch`` of :class:`Observations`: parts of a person."""

CARRYING_PARTS = TOUCH_PARTS[:5]
"""Feet, hands and seat, which carry people most."""

TOUCHED = ("world", "object", "own body", "person", "nothing")
"""Columns of ``touch`` of :class:`Observations`: what a part touches."""

CHOICES = ("posture", "touch")
"""Fields of :class:`Observations` of which each row has one right answer."""

PROBABILITIES = (*CHOICES, "on_floor", "child", "away")
"""Fields of :class:`Observations` that are probabilities; each has a share."""

_LEAST = 1e-4
"""Probability closest to 0 and 1 that counts as evidence: no network is surer than this."""


@dataclass(frozen=True)
class Observations(ShortRepr):
    """Result of a PersonObserver: what the photo shows of N people. Left is the person's own; NaN
    stands for what is not said.

    Each probability is calibrated for data in which a share of the answers is "yes". The engine
    takes this share out (:meth:`evidence`). A share is NaN where its probabilities are.

    Attributes:
        posture: (N, 9) probability of each of :data:`POSTURES`; a row sums to 1 or is NaN.
        touch: (N, 10, 5) probability that each of :data:`TOUCH_PARTS` touches each of
            :data:`TOUCHED`: the world (floor, seat, wall or another support), an object or an
            animal that it holds or pets and that does not carry the person, another part of the
            own body, another person, or nothing; a row sums to 1 or is NaN.
        on_floor: (N, 2) probability that the left and right foot, if it touches the world, touches
            floor or ground, and not a pedal, a board, a step or a seat.
        child: (N,) probability that the person is younger than about 12 years.
        away: (N,) probability that the person is seen from behind: the chest faces away from the
            camera, whatever the head does. Of a person seen from the side it does not.
        head: (N, 3) unit vector, direction in which the face looks, in the photo's camera frame:
            (0, 0, -1) looks along the optical axis towards the camera. It is that of the head, not
            of the eyes.
        head_sigma: (N,) degrees, standard deviation of ``head`` in each of the two directions
            across it.
        posture_share: (9,), sums to 1.
        touch_share: (10, 5), a row sums to 1; 0 for answers that are never given.
        on_floor_share: (2,).
        child_share: a number.
        away_share: a number.
    """

    posture: FloatArray = field(metadata=shape("N", len(POSTURES)))
    touch: FloatArray = field(metadata=shape("N", len(TOUCH_PARTS), len(TOUCHED)))
    on_floor: FloatArray = field(metadata=shape("N", 2))
    child: FloatArray = field(metadata=shape("N"))
    away: FloatArray = field(metadata=shape("N"))
    head: FloatArray = field(metadata=shape("N", 3))
    head_sigma: FloatArray = field(metadata=shape("N"))
    posture_share: FloatArray = field(metadata=shape(len(POSTURES)))
    touch_share: FloatArray = field(metadata=shape(len(TOUCH_PARTS), len(TOUCHED)))
    on_floor_share: FloatArray = field(metadata=shape(2))
    child_share: float = math.nan
    away_share: float = math.nan

    @classmethod
    def unknown(cls, people: int) -> Observations:
        """Return observations of some people that say nothing; ``dataclasses.replace`` adds what
        is known.
        """
        import numpy as np

        shapes = {one.name: one.metadata["shape"] for one in fields(cls) if one.metadata}
        nothing: dict[str, Any] = {
            name: np.full([people if n == "N" else n for n in sizes], np.nan, np.float32)
            for name, sizes in shapes.items()
        }
        return cls(**nothing)

    def __len__(self) -> int:
        return len(self.posture)

    def expanded(self, rows: BoolArray) -> Observations:
        """Return observations of M people; unknown for all but the N whom ``rows``, (M,) bool,
        selects.
        """
        blank = Observations.unknown(len(rows))
        own = dict(per_person(self))
        for name, value in own.items():
            getattr(blank, name)[rows] = value
        return replace(self, **{name: getattr(blank, name) for name in own})

    def with_swapped_sides(self, rows: BoolArray) -> Observations:
        """Return observations with left and right limbs exchanged of the people whom ``rows``,
        (N,) bool, selects.
        """
        orders = {"touch": mirrored_order(TOUCH_PARTS), "on_floor": (1, 0)}
        return with_columns(self, rows, orders)

    def evidence(self, name: str) -> FloatArray:
        """Return what the photo says about one of :data:`PROBABILITIES` beyond its share, in the
        shape of the field; 0 where it says nothing.

        It is log(p / (1 - p)) - log(share / (1 - share)): add it to log odds of other sources. For
        :data:`CHOICES` it is log(p) - log(share). It is finite: p and share count as at least 1e-4,
        and at most 1 - 1e-4.
        """
        import numpy as np

        def log(values: Any) -> FloatArray:
            p = np.clip(np.asarray(values, np.float64), _LEAST, 1 - _LEAST)
            return np.log(p) if name in CHOICES else np.log(p / (1 - p))

        beyond = log(getattr(self, name)) - log(getattr(self, f"{name}_share"))
        return np.nan_to_num(beyond).astype(np.float32)
