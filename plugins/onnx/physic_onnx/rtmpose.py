"""Detect keypoints with RTMW, one person at a time, and with RTMW3D in three dimensions.

The networks classify x and y separately (SimCC, arXiv:2107.03332), RTMW3D the depth too. MMPose
trains them on RGB, and its own deployment feeds RGB, though rtmlib feeds BGR.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_networks.networks import WEIGHTS_HELP
from physic_networks.top_down import scores_to_confidence

from .sessions import OnnxOptions
from .top_down import TopDownBackend

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import FloatArray, Keypoints
    from physic_networks.top_down import Crop

DEPTH_RANGE_M = 2.1744869
"""Depth of RTMW3D's last bin, metres; its first one is as far in front of the hips (z_range of
SimCC3DLabel).
"""
POINT_SIGMA = 3.0
"""Standard deviation of RTMW3D's points, px of the crop: that of the Gaussian that it is trained to
return.
"""
DEPTH_SIGMA_M = 0.07
"""Standard deviation of RTMW3D's depths, metres: that of a normal distribution whose mean absolute
value is all of the published error (MPJPE .056 and .057 m on H3WB, whose photos it was trained on).
Errors of single joints are not published.
"""
LIMB_LENGTHS_M = {
    ("hip", "knee"): 0.38,
    ("knee", "ankle"): 0.43,
    ("shoulder", "elbow"): 0.26,
    ("elbow", "wrist"): 0.23,
}
"""Lengths in the embedded body of mean shape, metres."""
STATURE_M = 1.72
"""Stature of a mean adult, metres."""


class RtmPoseOptions(OnnxOptions):
    """Settings of RTMPose."""

    weights: str = Field("rtmw-l-384x288", description=WEIGHTS_HELP)


class RtmPose(TopDownBackend):
    """Keypoint detector by RTMW with 133 joints; its input is RGB.

    A joint's confidence is the lower one of its peaks in x and y, which may exceed 1, and are cut
    there.
    """

    written_for = 1
    Options = RtmPoseOptions
    options: RtmPoseOptions
    crop_size = (384, 288)

    def decode(self, outputs: list[FloatArray]) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
        """Return the peaks in px of the crop, of a network of three dimensions with their depths in
        metres.
        """
        height, width = self.crop_size
        along_x, along_y, *along_z = outputs
        split = along_x.shape[2] / width
        if (
            along_y.shape[:2] != along_x.shape[:2]
            or along_y.shape[2] != split * height
            or split < 1
        ):
            raise BackendError(
                f"{self.network.name} returned simcc_x {along_x.shape} and simcc_y "
                f"{along_y.shape} for {width} x {height} px: expected equally many bins "
                "per pixel along both axes"
            )
        points = np.stack([along_x.argmax(-1), along_y.argmax(-1)], -1) / split
        if along_z:
            (along,) = along_z
            depth = (2 * along.argmax(-1) / along.shape[2] - 1) * DEPTH_RANGE_M
            points = np.concatenate([points, depth[..., None]], -1)
        score = np.minimum(along_x.max(-1), along_y.max(-1)).astype(np.float64)
        return points, scores_to_confidence(score), (height, width)


class Rtmw3dOptions(RtmPoseOptions):
    """Settings of RTMW3D."""

    weights: str = Field("rtmw3d-x", description=WEIGHTS_HELP)


class Rtmw3d(RtmPose):
    """Keypoint detector by RTMW3D with 133 joints, face, feet and hands included, and their depths.

    The depths are metres from the middle of the hips. As published, the photo is not mirrored for a
    second look. Where a pixel lies in metres follows from the limbs of a mean adult, see
    :func:`metres_per_pixel`. The errors that it states were not measured here: see
    :data:`POINT_SIGMA` and :data:`DEPTH_SIGMA_M`.
    """

    Options = Rtmw3dOptions
    options: Rtmw3dOptions

    def complete(
        self, keypoints: Keypoints, decoded: FloatArray, crops: Sequence[Crop]
    ) -> Keypoints:
        """Add the joints in metres, and the errors of points and depths."""
        names = keypoints.joint_set.names
        hips = [names.index("left_hip"), names.index("right_hip")]
        points = keypoints.points - keypoints.points[:, hips].mean(1, keepdims=True)
        depth = decoded[..., 2]
        scale = metres_per_pixel(keypoints, depth)
        world = np.concatenate([points * scale[:, None, None], depth[..., None]], -1)
        sigma = np.array([POINT_SIGMA * abs(crop.step[0]) for crop in crops])
        return replace(
            keypoints,
            world=world,
            sigma=np.broadcast_to(sigma[:, None], keypoints.confidence.shape).copy(),
            depth_sigma=np.full(keypoints.confidence.shape, DEPTH_SIGMA_M),
        )


def metres_per_pixel(keypoints: Keypoints, depth: FloatArray) -> FloatArray:
    """Return the scale (N,) with which the limbs of N people are as long as those of a mean adult.

    The least-squares solution of ``(scale * length in px)^2 + (difference in depth)^2 = length^2``
    over the limbs, each weighed by its confidence. A scale with which the person would be less than
    a third or more than one and a half of an adult's height is cut there.

    Args:
        keypoints: keypoints of a skeleton with arms and legs.
        depth: (N, J) metres.
    """
    names = keypoints.joint_set.names
    rows = np.array(
        [
            [names.index(f"{side}_{end}") for end in limb]
            for limb in LIMB_LENGTHS_M
            for side in ("left", "right")
        ]
    )
    length = np.repeat(list(LIMB_LENGTHS_M.values()), 2)
    pixels = ((keypoints.points[:, rows[:, 0]] - keypoints.points[:, rows[:, 1]]) ** 2).sum(-1)
    across = length**2 - (depth[:, rows[:, 0]] - depth[:, rows[:, 1]]) ** 2
    weight = keypoints.confidence[:, rows].min(-1) + 1e-6
    square = (weight * pixels * across).sum(1) / ((weight * pixels**2).sum(1) + 1e-9)
    tall = STATURE_M / np.maximum(np.ptp(keypoints.points, axis=1).max(-1), 1.0)
    return np.asarray(np.clip(np.sqrt(np.maximum(square, 0)), tall / 3, 1.5 * tall))
