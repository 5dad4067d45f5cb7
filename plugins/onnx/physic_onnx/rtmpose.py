"""Detect keypoints with RTMPose, RTMW or DWPose, one person at a time, and with RTMW3D in three
dimensions.

The networks classify x and y separately (SimCC, arXiv:2107.03332), RTMW3D the depth too. MMPose
trains these networks on RGB, and its own deployment feeds RGB. rtmlib feeds the same files BGR; set
``channels = "bgr"`` to compare with it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_networks.top_down import scores_to_confidence

from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackendOptions, PortSpec
from .top_down import TopDownBackend, TopDownOptions, run_batches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import FloatArray, Keypoints
    from physic_networks.top_down import Crop

_LINE = (None, None, None)
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


class RtmPoseOptions(TopDownOptions):
    """Settings of RTMPose."""

    weights: str = Field("rtmw-l-384x288", description=WEIGHTS_HELP)
    channels: Literal["rgb", "bgr"] = Field(
        "rgb",
        description="order of the channels for the network; it was trained on RGB, and rtmlib "
        "feeds BGR",
    )
    full_score: float = Field(
        1.0,
        ge=1e-6,
        le=1e6,
        description="score that stands for certainty; SimCC's scores are the heights of peaks, "
        "which may exceed 1, "
        "and are cut there",
    )


class RtmPose(TopDownBackend):
    """Keypoint detector by RTMPose, RTMW or DWPose with 133, 26 or 17 joints; its input is RGB.

    A joint's confidence is the lower one of its peaks in x and y.
    """

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = RtmPoseOptions
    options: RtmPoseOptions
    signatures: ClassVar = {
        "SimCC": GraphSignature(
            (PortSpec("input", ("images", "image"), shape=(None, 3, None, None)),),
            (
                PortSpec("simcc_x", ("x", "output_x", "output"), shape=_LINE),
                PortSpec("simcc_y", ("y", "output_y"), shape=_LINE),
            ),
            by_position=True,
        ),
    }

    def is_bgr(self) -> bool:
        """Return whether the option ``channels`` is "bgr"."""
        return self.options.channels == "bgr"

    def decode(self, crops: FloatArray) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
        """Return the peaks in px of the crop, of a network of three dimensions with their depths in
        metres.
        """
        height, width = crops.shape[2:]
        along_x, along_y, *along_z = run_batches(self.network, {"input": crops}, self.options.batch)
        split = along_x.shape[2] / width
        if (
            along_y.shape[:2] != along_x.shape[:2]
            or along_y.shape[2] != split * height
            or split < 1
        ):
            raise BackendError(
                f"{self.network.network.name} returned simcc_x {along_x.shape} and simcc_y "
                f"{along_y.shape} for {width} x {height} px: as many bins a pixel along both were "
                "expected"
            )
        points = np.stack([along_x.argmax(-1), along_y.argmax(-1)], -1) / split
        if along_z:
            (along,) = along_z
            if along.shape[:2] != along_x.shape[:2]:
                raise BackendError(
                    f"{self.network.network.name} returned simcc_z {along.shape} of other joints"
                )
            depth = (2 * along.argmax(-1) / along.shape[2] - 1) * DEPTH_RANGE_M
            points = np.concatenate([points, depth[..., None]], -1)
        score = np.minimum(along_x.max(-1), along_y.max(-1)).astype(np.float64)
        return points, scores_to_confidence(score, self.options.full_score), (height, width)


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

    Options: ClassVar[type[OnnxBackendOptions]] = Rtmw3dOptions
    options: Rtmw3dOptions
    crop_size = (384, 288)
    signatures: ClassVar = {
        "SimCC of three dimensions": GraphSignature(
            (PortSpec("input", ("images", "image"), shape=(None, 3, None, None)),),
            tuple(
                PortSpec(f"simcc_{axis}", (axis, f"output_{axis}"), shape=_LINE) for axis in "xyz"
            ),
            by_position=True,
        ),
    }

    def complete(self, found: Keypoints, decoded: FloatArray, crops: Sequence[Crop]) -> Keypoints:
        """Add the joints in metres, and the errors of points and depths."""
        names = found.joint_set.names
        hips = [names.index("left_hip"), names.index("right_hip")]
        points = found.points - found.points[:, hips].mean(1, keepdims=True)
        depth = decoded[..., 2]
        scale = metres_per_pixel(found, depth)
        world = np.concatenate([points * scale[:, None, None], depth[..., None]], -1)
        sigma = np.array([POINT_SIGMA * abs(crop.step[0]) for crop in crops])
        return replace(
            found,
            world=world,
            sigma=np.broadcast_to(sigma[:, None], found.confidence.shape).copy(),
            depth_sigma=np.full(found.confidence.shape, DEPTH_SIGMA_M),
        )


def metres_per_pixel(found: Keypoints, depth: FloatArray) -> FloatArray:
    """Return the scale (N,) with which the limbs of N people are as long as those of a mean adult.

    The least-squares solution of ``(scale * length in px)^2 + (difference in depth)^2 = length^2``
    over the limbs, each weighed by its confidence. A scale with which the person would be less than
    a third or more than one and a half of an adult's height is cut there.

    Args:
        found: keypoints of a skeleton with arms and legs.
        depth: (N, J) metres.
    """
    names = found.joint_set.names
    rows = np.array(
        [
            [names.index(f"{side}_{end}") for end in limb]
            for limb in LIMB_LENGTHS_M
            for side in ("left", "right")
        ]
    )
    length = np.repeat(list(LIMB_LENGTHS_M.values()), 2)
    pixels = ((found.points[:, rows[:, 0]] - found.points[:, rows[:, 1]]) ** 2).sum(-1)
    across = length**2 - (depth[:, rows[:, 0]] - depth[:, rows[:, 1]]) ** 2
    weight = found.confidence[:, rows].min(-1) + 1e-6
    square = (weight * pixels * across).sum(1) / ((weight * pixels**2).sum(1) + 1e-9)
    tall = STATURE_M / np.maximum(np.ptp(found.points, axis=1).max(-1), 1.0)
    return np.asarray(np.clip(np.sqrt(np.maximum(square, 0)), tall / 3, 1.5 * tall))
