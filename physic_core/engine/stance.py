"""Whether each foot stands: by its keypoints, by the depth behind it, and by the size that standing gives the scene.

At the pixels of a foot on the ground, the depth map of the photo and that of the scene without people nearly agree: the
ground continues behind the foot. A foot in the air has a gap. The gap is the logarithm of the ratio of both depths;
over level ground it is about the foot's height as a share of the camera's height, in any unit and at any distance. A
foot on a seat or a table also has such a gap. Where surface labels show one of these around the foot, its gap says
nothing of the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from physic_core.body.feet_in_picture import foot_touch_probability
from physic_core.engine.placement.background import dilate_square
from physic_core.engine.placement.detections import ObservedPeople
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray

MIN_FOOT_GAP = 0.1
"""Minimum gap of a lifted foot; feet on the ground have at most 0.08 in photos."""

_MIN_FOOT_HEIGHT_M = 0.12
"""Minimum height of a lifted foot above the floor, metres. Heels and ankles are higher than soles, and the gaps of a
low camera are large."""

_LIFTED_SIGMAS = 3.0  # from standing on the floor
_MIN_CONFIDENCE = 0.3  # of the keypoints of a foot
_RADIUS_SHARE = 0.02  # of the height of a person's mask: pixels around a keypoint
_MIN_PIXELS = 4
_PITCH_DEG = 20.0  # between heel and toe in the image; beyond, the lower end alone counts
_RING_SHARE = 0.1  # of the height of a person's mask: background around a foot, where both maps must agree
_MARGIN_PX = 3  # between people and background; depth maps are blurred at outlines
_MAX_BACKGROUND_GAP = 0.15  # where the maps differ more, they are not aligned
_MAX_RAISED_SHARE = 0.5  # of the background around a foot that carries people over the ground

_ON_FLOOR_SHARE = 0.95  # of feet that touch something; the others are on seats and steps
_FURNITURE_SHARE = 0.4  # of feet among seats and tables that stand on the floor all the same
_GAP_STANDING, _GAP_IN_AIR = (0.02, 0.05), (0.2, 0.15)  # mean and spread of the gap behind feet
_MAP_WRONG = 0.05  # share of people whose depth in the photo is wrong
_WRONG_GAPS = 6.0  # range of their gaps


@dataclass(frozen=True)
class Stance(ShortRepr):
    """How N people stand, left and right foot.

    Attributes:
        touch: (N, 2) probability by the keypoints that the foot touches floor, seat or support.
        gap: (N, 2) logarithm of the depth behind the foot by its own, NaN where unknown.
        on_furniture: (N, 2) bool, feet among surfaces that can carry a foot above the ground; None without labels.
        stands: (N, 2) probability that the foot stands on the floor, which is not the photo's without one.
        score: (N,) standard deviations from standing on the floor: about 0 for people who stand, negative for feet in
            the air. Their rays meet the floor farther away, so that the scale by the soles is less than by the torso.
            NaN where soles or torso are not visible, or the point map does not state ``people_farther``.
    """

    touch: FloatArray
    gap: FloatArray
    on_furniture: BoolArray | None
    stands: FloatArray
    score: FloatArray

    def expanded(self, rows: BoolArray) -> Stance:
        """Return N rows from those of the people selected by ``rows`` (N,); the others have average feet."""
        average = foot_touch_probability(np.zeros((1, 0, 2)), ())[0]

        def wider(array: NDArray[Any], empty: FloatArray | float = np.nan) -> NDArray[Any]:
            found = np.full((len(rows), *array.shape[1:]), empty, array.dtype)
            found[rows] = array
            return found

        among = None if self.on_furniture is None else wider(self.on_furniture, False)
        touch, stands = wider(self.touch, average), wider(self.stands, average)
        return Stance(touch, wider(self.gap), among, stands, wider(self.score))


def standing_prior(touch: FloatArray, gap: FloatArray, on_furniture: BoolArray | None) -> tuple[FloatArray, FloatArray]:
    """Return the probability that feet stand on the floor, and that the photo's depth of people is right.

    The first is (N, 2), before any floor is known; the second (N,). A gap that is too large for a foot in the air says
    that the depth is wrong, and nothing of the foot. See :class:`Stance` for the arguments.
    """
    share = _ON_FLOOR_SHARE * np.where(False if on_furniture is None else on_furniture, _FURNITURE_SHARE, 1.0)
    prior = share * touch
    known = np.isfinite(gap) & ~np.asarray(False if on_furniture is None else on_furniture)

    def density(mean: float, spread: float) -> FloatArray:
        return np.asarray(np.exp(-0.5 * ((gap - mean) / spread) ** 2) / (spread * math.sqrt(2 * math.pi)))

    standing = prior * np.where(known, density(*_GAP_STANDING), 1.0)
    in_air = (1 - prior) * np.where(known, density(*_GAP_IN_AIR), 1.0)
    right = (1 - _MAP_WRONG) * (standing + in_air).prod(1)
    wrong = _MAP_WRONG * np.where(known, 1 / _WRONG_GAPS, 1.0).prod(1)
    is_right = right / (right + wrong)
    by_gap = standing / np.maximum(standing + in_air, 1e-300)
    return is_right[:, None] * by_gap + (1 - is_right[:, None]) * prior, is_right


def find_lifted_feet(stance: Stance, held: Tensor, camera_height_m: float) -> Tensor | None:
    """Return the left and right feet in the air, (B, 2) bool; None without labels of furniture.

    A foot with a gap is lifted. A person is in the air if both feet are, if the hands hold something and the mean of
    the known gaps is that of a lifted foot, or if the scale by the soles says so: the depth of one foot is less certain
    than that of both. People who lift a weight also hold something, with a mean gap of 0.07.

    Args:
        stance: of B people.
        held: (B,) bool, people whose hands may hold something.
        camera_height_m: of the camera over the floor.
    """
    if stance.on_furniture is None:
        return None
    gap = torch.from_numpy(np.where(stance.on_furniture, np.nan, stance.gap))
    known = torch.isfinite(gap)
    lifted = known & _is_lifted(gap, camera_height_m)
    mean = torch.where(known, gap, 0.0).sum(1) / known.sum(1).clamp(min=1)
    airborne = lifted.all(1) | (held & _is_lifted(mean, camera_height_m))
    airborne |= torch.from_numpy(stance.score < -_LIFTED_SIGMAS)
    return lifted | airborne[:, None]


def _is_lifted(gap: Tensor, camera_height_m: float) -> Tensor:
    return (gap > MIN_FOOT_GAP) & (camera_height_m * (1 - torch.exp(-gap)) > _MIN_FOOT_HEIGHT_M)


def depth_gaps_at_feet(
    detections: ObservedPeople, photo: Tensor, scene: Tensor, raised: Tensor | None
) -> tuple[Tensor, Tensor]:
    """Measure the depth gap behind each foot: (B, 2), NaN where unknown; and which feet are on furniture, (B, 2) bool.

    It is the median over the person's pixels around heel and toe, or around the lower one for a foot that points up or
    down in the image, minus the median over the background around the foot.

    Args:
        detections: keypoints and masks of B people.
        photo: (H, W) depth of the photo, any unit, NaN where unknown.
        scene: (H, W) depth of the scene without people, in the same unit, NaN where unknown.
        raised: (H, W) bool, surfaces that can carry a foot above the ground, or None.
    """
    skeleton, masks = detections.skeleton, detections.masks.cpu()
    keypoints, confidence = detections.keypoints.cpu(), detections.confidence.cpu()
    log_ratio = scene.log() - photo.log()
    background = ~dilate_square(masks.any(0), _MARGIN_PX)
    row = {name: j for j, name in enumerate(skeleton.names)}
    gaps = torch.full((len(keypoints), 2), torch.nan, dtype=torch.float64)
    on_furniture = torch.zeros(len(keypoints), 2, dtype=torch.bool)
    for i, mask in enumerate(masks):
        rows = mask.any(1).nonzero()
        if not len(rows):
            continue
        size = float(rows[-1] - rows[0] + 1)
        for k, side in enumerate(SIDES):
            toe = next((row[f"{side}_{name}"] for name in ("foot_tip", "big_toe") if f"{side}_{name}" in row), None)
            ends = [j for j in (row.get(f"{side}_heel"), toe) if j is not None and confidence[i, j] >= _MIN_CONFIDENCE]
            places = keypoints[i, ends]
            if len(places) < 2 or not bool(torch.isfinite(places).all()):
                continue
            values = [_around(log_ratio, mask, place, max(2.0, _RADIUS_SHARE * size)) for place in places]
            ring = places.mean(0), _MARGIN_PX + _RING_SHARE * size
            ground = _around(log_ratio, background, *ring)
            if raised is not None:
                on_furniture[i, k] = float(_around(raised.float(), background, *ring).mean()) > _MAX_RAISED_SHARE
            across, down = (float(x) for x in places[1] - places[0])
            pitch = math.degrees(math.atan2(down, abs(across)))
            lower = values[1] if pitch > 0 else values[0]
            if abs(pitch) < _PITCH_DEG or len(lower) < _MIN_PIXELS:
                lower = torch.cat(values)
            if min(len(lower), len(ground)) < _MIN_PIXELS:
                continue
            off = ground.double().median()
            if abs(float(off)) < _MAX_BACKGROUND_GAP:
                gaps[i, k] = lower.double().median() - off
    return gaps, on_furniture


def _around(values: Tensor, mask: Tensor, place: Tensor, radius: float) -> Tensor:
    """Return the finite values (n,) of a person's pixels in a square around a place (2,) px."""
    height, width = mask.shape
    x, y = (float(v) for v in place)
    columns = slice(max(0, round(x - radius)), min(width, max(0, round(x + radius) + 1)))
    rows = slice(max(0, round(y - radius)), min(height, max(0, round(y + radius) + 1)))
    chosen = values[rows, columns][mask[rows, columns]]
    return chosen[torch.isfinite(chosen)]
