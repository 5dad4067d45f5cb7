"""Touch of feet, hands and seat, from the picture before people are placed.

What the person observer says of a part decides.

At the pixels of a foot on the ground, the depth map of the photo and that of the scene without
people nearly agree: the ground continues behind the foot. A foot in the air has a gap, the
logarithm of the ratio of both depths. A foot on a seat or a table also has one: where surface
labels show these around the foot, its gap does not describe the floor. A gap larger than any foot
can have shows that the photo's depth of the person is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.ground.carriers import NOTHING, Carried
from physic_core.engine.ground.touch import LEAST_PROBABILITY, observed_log_odds
from physic_core.geometry.pixels import dilate_square
from physic_core.types.arrays import PER_PERSON
from physic_core.types.observations import TOUCH_PARTS
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SEEN_CONFIDENCE, SIDES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, Keypoints, Observations

_TOES = ("foot_tip", "big_toe")
_RADIUS_SHARE = 0.02  # of the height of a person's mask: pixels around a keypoint
_MIN_PIXELS = 4
_PITCH_DEG = 20.0  # between heel and toe in the image; beyond, only the lower end counts
# Of the height of a person's mask: background around a foot, where both maps must agree.
_RING_SHARE = 0.1
_MARGIN_PX = 3  # between people and background; depth maps are blurred at outlines
_MAX_BACKGROUND_GAP = 0.15  # where the maps differ more, they are not aligned
_MAX_RAISED_SHARE = 0.5  # of the background around a foot that carries people over the ground

_GAP_STANDING = (0.02, 0.05)  # mean and sigma of the gap behind a foot that stands
_GAP_IN_AIR = (0.2, 0.15)  # the same behind a foot in the air
_MAP_WRONG = 0.05  # share of people whose depth in the photo is wrong
_WRONG_GAPS = 6.0  # range of their gaps

OBSERVED_COLUMNS = (*TOUCH_PARTS, "left_object", "right_object", "left_floor", "right_floor")
"""Columns of ``observed`` of :class:`Stance`: touch of the world by each part, hands that hold an
object, and feet that are on the floor if they touch anything.
"""


@dataclass(frozen=True)
class Stance(ShortRepr):
    """Evidence of a picture for the touch of N people; feet and hands are left and right.

    Attributes:
        observed: (N, 9) log odds by the person observer of each of :data:`OBSERVED_COLUMNS`, beyond
            those of its base rate; 0 where unknown.
        stands: (N, 2) probability that the foot stands on the floor; only a prior if no floor was
            found.
        rests: (N,) probability that the lowest skin rests on the floor, of people who lie, plank or
            are on all fours; NaN of others.
        carried: what people ride, and boards below their feet; None without any in the picture.
    """

    observed: FloatArray = field(metadata=PER_PERSON)
    stands: FloatArray = field(metadata=PER_PERSON)
    rests: FloatArray = field(metadata=PER_PERSON)
    carried: Carried | None = field(default=None, metadata=PER_PERSON)

    @staticmethod
    def in_picture(observations: Observations) -> Stance:
        """Return the stance of people by what is observed of them; feet of which nothing
        is said are on the floor as often as others that touch.
        """
        parts = [observations.evidence(name) for name in ("touch", "holds", "on_floor")]
        count = len(parts[0])
        stance = Stance(np.concatenate(parts, 1), np.zeros((count, 2)), np.full(count, np.nan))
        on_floor = _probability(observed_log_odds("floor", stance.observed[:, 7:]))
        return replace(stance, stands=on_floor * stance.limb_touch[:, :2])

    @staticmethod
    def unknown(count: int) -> Stance:
        """Return the stance of N average people."""
        from physic_core.types import Observations

        return Stance.in_picture(Observations.unknown(count))

    @property
    def limb_touch(self) -> FloatArray:
        """Probability (N, 5) that feet, hands and seat touch floor, seat or support."""
        odds = [
            observed_log_odds(kind, self.observed[:, own])
            for kind, own in (("foot", [0, 1]), ("hand", [2, 3]), ("seat", [4]))
        ]
        return _probability(np.concatenate(odds, 1))

    @property
    def holds(self) -> BoolArray:
        """Left and right hands (N, 2) bool that probably hold something."""
        columns = [OBSERVED_COLUMNS.index(f"{side}_object") for side in SIDES]
        return np.asarray(observed_log_odds("object", self.observed[:, columns]) > 0)

    @property
    def stands_on_both_feet(self) -> BoolArray:
        """People (N,) bool with both feet probably on the floor."""
        return np.asarray((self.stands >= LEAST_PROBABILITY).all(1))

    def with_resting(self, limbs: BoolArray) -> Stance:
        """Return the stance of people whose feet and hands (N, 4) lie lowest: where the lowest skin
        probably rests, these touch by what is seen of them, or else by that; not hands that hold
        something, which may be a bar.
        """
        lifted = (1 - self.limb_touch[:, :4]) * (1 - self.rests[:, None])
        usual = replace(self, observed=np.zeros_like(self.observed)).limb_touch[:, :4]
        odds = np.log1p(-lifted) - np.log(lifted) - np.log(usual) + np.log1p(-usual)
        observed = self.observed.copy()
        rests = limbs & (self.rests >= LEAST_PROBABILITY)[:, None]
        rests[:, 2:] &= ~self.holds
        observed[:, :4] = np.where(rests, odds, observed[:, :4])
        return replace(self, observed=observed)

    def expanded(self, rows: BoolArray) -> Stance:
        """Return N rows from those of the people selected by ``rows`` (N,); the others have average
        feet.
        """

        def wider(array: NDArray[Any], empty: FloatArray | float = np.nan) -> NDArray[Any]:
            found = np.full((len(rows), *array.shape[1:]), empty, array.dtype)
            found[rows] = array
            return found

        stands = wider(self.stands, Stance.unknown(1).stands[0])
        carried = self.carried and replace(
            self.carried,
            ridden=wider(self.carried.ridden, NOTHING),
            board=wider(self.carried.board, NOTHING),
        )
        return Stance(wider(self.observed, 0.0), stands, wider(self.rests), carried)


def _probability(log_odds: FloatArray) -> FloatArray:
    return np.asarray(1 / (1 + np.exp(-log_odds)))


def _height_px(mask: Tensor) -> float:
    """Return the height of a mask (H, W), px; 0 if it is empty."""
    rows = mask.any(1).nonzero()
    return float(rows[-1] - rows[0] + 1) if len(rows) else 0.0


def standing_prior(
    prior: FloatArray, gap: FloatArray, on_furniture: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the probability that feet stand on the floor, and that the photo's depth of people is
    right.

    The first is (N, 2), before any floor is known; the second (N,). A gap that is too large for a
    foot in the air shows that the depth is wrong, and does not count for the foot.

    Args:
        prior: (N, 2) probability by the observer that the feet stand on the floor.
        gap: (N, 2) of :func:`depth_gaps_at_feet`.
        on_furniture: (N, 2) bool of the same.
    """
    known = np.isfinite(gap) & ~on_furniture

    def density(mean: float, spread: float) -> FloatArray:
        return np.asarray(
            np.exp(-0.5 * ((gap - mean) / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
        )

    standing = prior * np.where(known, density(*_GAP_STANDING), 1.0)
    in_air = (1 - prior) * np.where(known, density(*_GAP_IN_AIR), 1.0)
    right = (1 - _MAP_WRONG) * (standing + in_air).prod(1)
    wrong = _MAP_WRONG * np.where(known, 1 / _WRONG_GAPS, 1.0).prod(1)
    is_right = right / (right + wrong)
    by_gap = standing / np.maximum(standing + in_air, 1e-300)
    return is_right[:, None] * by_gap + (1 - is_right[:, None]) * prior, is_right


def depth_gaps_at_feet(
    keypoints: Keypoints, masks: Tensor, photo: Tensor, scene: Tensor, raised: Tensor
) -> tuple[FloatArray, BoolArray]:
    """Measure the depth gap behind each foot: (B, 2), NaN where unknown; and which feet are on
    furniture, (B, 2) bool.

    It is the median over the person's pixels around heel and toe, or around the lower one for a
    foot that points up or down in the image, minus the median over the background around the foot.

    Args:
        keypoints: of B people.
        masks: (B, H, W) bool, visible pixels of each person.
        photo: (H, W) depth of the photo, any unit, NaN where unknown.
        scene: (H, W) depth of the scene without people, in the same unit, NaN where unknown.
        raised: (H, W) bool, surfaces that can carry a foot above the ground.
    """
    log_ratio = scene.log() - photo.log()
    background = ~dilate_square(masks.any(0), _MARGIN_PX)
    row = {name: j for j, name in enumerate(keypoints.joint_set.names)}
    gaps = np.full((len(masks), 2), np.nan)
    on_furniture = np.zeros((len(masks), 2), bool)
    for i, mask in enumerate(masks):
        size = _height_px(mask)
        for k, side in enumerate(SIDES):
            toe = next((row[f"{side}_{name}"] for name in _TOES if f"{side}_{name}" in row), None)
            ends = [
                j
                for j in (row.get(f"{side}_heel"), toe)
                if j is not None and keypoints.confidence[i, j] >= SEEN_CONFIDENCE
            ]
            places = keypoints.points[i, ends]
            if len(places) < 2 or not np.isfinite(places).all():
                continue
            ring = places.mean(0), _MARGIN_PX + _RING_SHARE * size
            share = float(_finite_values_around(raised.float(), background, *ring).mean())
            on_furniture[i, k] = share > _MAX_RAISED_SHARE
            radius = max(2.0, _RADIUS_SHARE * size)
            values = [_finite_values_around(log_ratio, mask, place, radius) for place in places]
            ground = _finite_values_around(log_ratio, background, *ring)
            gaps[i, k] = _depth_gap(places[1] - places[0], values, ground)
    return gaps, on_furniture


def _depth_gap(way: FloatArray, foot: Sequence[Tensor], ground: Tensor) -> float:
    """Return the gap behind a foot; NaN where it is unknown.

    Args:
        way: (2,) px from heel to toe.
        foot: log ratios of depth (n,) around both.
        ground: the same (m,) around the foot.
    """
    across, down = (float(x) for x in way)
    pitch = math.degrees(math.atan2(down, abs(across)))
    lower = foot[1] if pitch > 0 else foot[0]
    if abs(pitch) < _PITCH_DEG or len(lower) < _MIN_PIXELS:
        lower = torch.cat(list(foot))
    if min(len(lower), len(ground)) < _MIN_PIXELS:
        return math.nan
    off = ground.double().median()
    known = abs(float(off)) < _MAX_BACKGROUND_GAP
    return float(lower.double().median() - off) if known else math.nan


def _finite_values_around(values: Tensor, mask: Tensor, place: FloatArray, radius: float) -> Tensor:
    """Return the finite values (n,) of a mask in a square around a place (2,) px."""
    height, width = mask.shape
    x, y = (float(v) for v in place)
    columns = slice(max(0, round(x - radius)), min(width, max(0, round(x + radius) + 1)))
    rows = slice(max(0, round(y - radius)), min(height, max(0, round(y + radius) + 1)))
    chosen = values[rows, columns][mask[rows, columns]]
    return chosen[torch.isfinite(chosen)]
