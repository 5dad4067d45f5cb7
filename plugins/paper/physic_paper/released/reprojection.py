"""Reprojection term of the paper's released code: weights of keypoints, and a mean over 133
keypoints.

The sum is divided by 133 for every joint set, so that each keypoint has the same gradient as in the
released code.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from physic_core.engine.joint import PosedBodies, Sampling, Term, finite_keypoints
from physic_core.engine.state import State
from physic_core.geometry import project
from physic_core.types import SIDES, Skeleton, is_finger

_LEAST_CONFIDENCE = 0.5
_LEAST_HAND_CONFIDENCE = 0.7
_BODY_WEIGHT = 10.0
_KEYPOINTS = 133
_MASK_GROWTH_PX = 16  # four dilations by a square of 9 px
_LONGEST_SIDE_PX = 1024  # of the images in the released code


def released_keypoint_weights(
    skeleton: Skeleton, points: Tensor, confidence: Tensor, masks: Tensor
) -> Tensor:
    """Compute the weight of each keypoint (B, J) from its confidence and from the masks of people.

    Confidences below 0.5 count as 0; those of body and feet are multiplied by ten. Hands with a
    mean below 0.7 and keypoints outside the masks have weight 0.

    Args:
        skeleton: of the J keypoints.
        points: (B, J, 2) px.
        confidence: (B, J).
        masks: (B, H, W) bool, visible pixels of each person; their union is grown by 16 px, more in
            large images.

    Returns:
        (B, J); 0 for keypoints that are not finite.
    """
    finite = torch.isfinite(points).all(-1) & torch.isfinite(confidence)
    weight = torch.where(
        finite & (confidence >= _LEAST_CONFIDENCE), confidence, torch.zeros_like(confidence)
    )
    names = skeleton.names
    for side in SIDES:
        hand = [j for j, name in enumerate(names) if _is_of_hand(name, side)]
        if hand:
            sure = weight[:, hand].mean(1, keepdim=True) >= _LEAST_HAND_CONFIDENCE
            weight[:, hand] = weight[:, hand] * sure
    body = torch.tensor([_is_body_or_foot(name) for name in names])
    height, width = masks.shape[-2:]
    reach = round(_MASK_GROWTH_PX * max(1.0, max(height, width) / _LONGEST_SIDE_PX))
    is_near = is_near_mask(torch.nan_to_num(points), masks.any(0), reach)
    return weight * torch.where(body, _BODY_WEIGHT, 1.0).to(weight) * is_near


def released_reprojection(
    projected: Tensor, observed: Tensor, weight: Tensor, size: Tensor, people: int
) -> Tensor:
    """Return the weighted reprojection error relative to the image size, a mean over people, 133
    keypoints and axes.

    Args:
        projected: (B, J, 2) px.
        observed: (B, J, 2) px, finite.
        weight: (B, J).
        size: (2,) width and height of the image, px.
        people: number of people in the image.

    Returns:
        (B,) summand of each person.
    """
    error = ((projected - observed) / size).abs().sum(-1)
    return (weight * error).sum(-1) / (2 * _KEYPOINTS * people)


def released_weights(state: State) -> Tensor:
    """Return the weights (B, J) of :func:`released_keypoint_weights`."""
    points, confidence = finite_keypoints(state)
    return released_keypoint_weights(state.skeleton, points, confidence, state.masks)


class ReleasedReprojectionTerm(Term):
    """Reprojection term of preset "release": mean absolute error of all keypoints, relative to the
    image size.
    """

    def __init__(self, sampling: Sampling, weight: float) -> None:
        self._sampling = sampling
        self._weight = weight
        height, width = sampling.state.masks.shape[-2:]
        self._size = sampling.person_px.new_tensor([width, height])
        self._observed, _ = finite_keypoints(sampling.state)
        self.weights = {"reprojection": sampling.keypoint_weights}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "reprojection"."""
        projected = project(bodies.keypoints, self._sampling.state.K)
        people = len(projected)
        error = released_reprojection(
            projected, self._observed, self._sampling.keypoint_weights, self._size, people
        )
        return {"reprojection": self._weight * error} if self._weight else {}


def is_near_mask(uv: Tensor, mask: Tensor, reach: int) -> Tensor:
    """Return whether a mask (H, W) is set within a square of ``reach`` px around coordinates (...,
    2): (...) bool.

    An integral image makes the time independent of ``reach``.
    """
    height, width = mask.shape
    sums = F.pad(mask.long().cumsum(0).cumsum(1), (1, 0, 1, 0))
    u, v = uv.round().long().unbind(-1)
    left = (u - reach).clamp(0, width)
    right = (u + reach + 1).clamp(0, width)
    top = (v - reach).clamp(0, height)
    bottom = (v + reach + 1).clamp(0, height)
    return (sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]) > 0


def _is_body_or_foot(name: str) -> bool:
    """Return whether a keypoint is on body or feet, not on hands, face or the surface of the
    body.
    """
    fine = name.endswith(("_inner_surface", "_outer_surface", "mouth_corner_surface", "hand_root"))
    return not (fine or is_finger(name) or name.startswith("face_point"))


def _is_of_hand(name: str, side: str) -> bool:
    """Return whether a keypoint is on the hand of a side."""
    prefix, _, rest = name.partition("_")
    return prefix == side and (rest == "hand_root" or is_finger(rest))
