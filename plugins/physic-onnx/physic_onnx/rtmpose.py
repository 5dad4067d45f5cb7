"""Detect keypoints with RTMPose, RTMW or DWPose, one person at a time.

The networks classify x and y separately (SimCC). MMPose trains these networks on RGB, and its own
deployment feeds RGB. rtmlib feeds the same files BGR; set ``channels = "bgr"`` to compare with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.top_down import scores_to_confidence
from physic_core.errors import BackendError

from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackendOptions, PortSpec
from .top_down import TopDownKeypoints, TopDownOptions, run_batches

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_LINE = (None, None, None)


class RtmPoseOptions(TopDownOptions):
    """Settings of RTMPose."""

    weights: str = Field("rtmw-l-384x288", description=WEIGHTS_HELP)
    channels: Literal["rgb", "bgr"] = Field(
        "rgb", description="order in which the network sees colours; it was trained on RGB, and rtmlib feeds BGR"
    )
    full_score: float = Field(
        1.0,
        ge=1e-6,
        le=1e6,
        description="score that stands for certainty; SimCC's scores are the heights of peaks, which may exceed 1, "
        "and are cut there",
    )


class RtmPose(TopDownKeypoints):
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

    def bgr(self) -> bool:
        """Return whether the option says so."""
        return self.options.channels == "bgr"

    def decode(self, crops: FloatArray) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
        """Return the peaks in px of the crop."""
        height, width = crops.shape[2:]
        along_x, along_y = run_batches(self.network, {"input": crops}, ["simcc_x", "simcc_y"], self.options.batch)
        return *self.peaks(along_x, along_y, width, height), (height, width)

    def peaks(self, along_x: FloatArray, along_y: FloatArray, width: int, height: int) -> tuple[FloatArray, FloatArray]:
        """Return the peaks (N, J, 2) in px of the crop, and the confidence (N, J)."""
        split = along_x.shape[2] / width
        if along_y.shape[:2] != along_x.shape[:2] or along_y.shape[2] != split * height or split < 1:
            raise BackendError(
                f"{self.network.network.name} returned simcc_x {along_x.shape} and simcc_y {along_y.shape} for {width} "
                f"x {height} px: as many bins a pixel along both were expected"
            )
        points, score = simcc_peaks(along_x, along_y, split)
        return points, scores_to_confidence(score, self.options.full_score)


def simcc_peaks(along_x: FloatArray, along_y: FloatArray, split: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Decode keypoints of a network that classifies x and y separately (SimCC, arXiv:2107.03332).

    Args:
        along_x: (N, J, split * width).
        along_y: (N, J, split * height).
        split: bins per px of the network's input.

    Returns:
        Points (N, J, 2) in px of the network's input, and the lower of the two maxima (N, J).
    """
    points = np.stack([along_x.argmax(-1), along_y.argmax(-1)], -1) / split
    return points, np.minimum(along_x.max(-1), along_y.max(-1)).astype(np.float64)
