"""Feet in the air, from the depth gap between a foot and the scene behind it.

At the pixels of a foot on the ground, the depth map of the photo and that of the scene without people nearly agree: the
ground continues behind the foot. A foot in the air has a gap. The gap is the logarithm of the ratio of both depths;
over level ground it is about the foot's height as a share of the camera's height, in any unit and at any distance. A
foot on a seat or a table also has such a gap. Gaps are therefore measured only where surface labels show none of these
around the foot, and not at all without labels.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.placement.background import dilate_square
from physic_core.engine.placement.detections import ObservedPeople
from physic_core.types.skeletons import SIDES

MIN_FOOT_GAP = 0.1
"""Minimum gap of a lifted foot; feet on the ground have at most 0.08 in photos."""

_MIN_FOOT_HEIGHT_M = 0.12
"""Minimum height of a lifted foot above the floor, metres. Heels and ankles are higher than soles, and the gaps of a
low camera are large."""

_MIN_CONFIDENCE = 0.3  # of the keypoints of a foot
_RADIUS_SHARE = 0.02  # of the height of a person's mask: pixels around a keypoint
_MIN_PIXELS = 4
_PITCH_DEG = 20.0  # between heel and toe in the image; beyond, the lower end alone counts
_RING_SHARE = 0.1  # of the height of a person's mask: background around a foot, where both maps must agree
_MARGIN_PX = 3  # between people and background; depth maps are blurred at outlines
_MAX_BACKGROUND_GAP = 0.15  # where the maps differ more, they are not aligned
_MAX_RAISED_SHARE = 0.5  # of the background around a foot that carries people over the ground


def find_lifted_feet(gap: Tensor, held: Tensor, camera_height_m: float) -> Tensor:
    """Return the left and right feet in the air, (B, 2) bool, from depth gaps.

    A foot with a gap is lifted. A person is in the air if both feet are, or if the hands hold something and the mean of
    the known gaps is that of a lifted foot: the depth of one foot is less certain than that of both. People who lift a
    weight also hold something, with a mean gap of 0.07.

    Args:
        gap: (B, 2) from :func:`depth_gaps_at_feet`.
        held: (B,) bool, people whose hands may hold something.
        camera_height_m: of the camera over the floor.
    """
    known = torch.isfinite(gap)
    lifted = known & _is_lifted(gap, camera_height_m)
    mean = torch.where(known, gap, 0.0).sum(1) / known.sum(1).clamp(min=1)
    airborne = lifted.all(1) | (held & _is_lifted(mean, camera_height_m))
    return lifted | airborne[:, None]


def _is_lifted(gap: Tensor, camera_height_m: float) -> Tensor:
    return (gap > MIN_FOOT_GAP) & (camera_height_m * (1 - torch.exp(-gap)) > _MIN_FOOT_HEIGHT_M)


def depth_gaps_at_feet(detections: ObservedPeople, photo: Tensor, scene: Tensor, raised: Tensor) -> Tensor:
    """Measure the depth gap behind each foot: (B, 2), NaN where unknown.

    It is the median over the person's pixels around heel and toe, or around the lower one for a foot that points up or
    down in the image, minus the median over the background around the foot.

    Args:
        detections: keypoints and masks of B people.
        photo: (H, W) metres, depth of the photo, NaN where unknown.
        scene: (H, W) metres, depth of the scene without people, NaN where unknown.
        raised: (H, W) bool, surfaces that can carry a foot above the ground. Feet among them have no gap.
    """
    skeleton, masks = detections.skeleton, detections.masks.cpu()
    keypoints, confidence = detections.keypoints.cpu(), detections.confidence.cpu()
    log_ratio = scene.log() - photo.log()
    background = ~dilate_square(masks.any(0), _MARGIN_PX)
    row = {name: j for j, name in enumerate(skeleton.names)}
    gaps = torch.full((len(keypoints), 2), torch.nan, dtype=torch.float64)
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
            if float(_around(raised.float(), background, *ring).mean()) > _MAX_RAISED_SHARE:
                continue
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
    return gaps


def _around(values: Tensor, mask: Tensor, place: Tensor, radius: float) -> Tensor:
    """Return the finite values (n,) of a person's pixels in a square around a place (2,) px."""
    height, width = mask.shape
    x, y = (float(v) for v in place)
    columns = slice(max(0, round(x - radius)), min(width, max(0, round(x + radius) + 1)))
    rows = slice(max(0, round(y - radius)), min(height, max(0, round(y + radius) + 1)))
    chosen = values[rows, columns][mask[rows, columns]]
    return chosen[torch.isfinite(chosen)]
