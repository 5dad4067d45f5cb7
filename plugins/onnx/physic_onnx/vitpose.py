"""Detect 133 whole-body keypoints with ViTPose heatmaps, one person at a time.

It was trained with MMPose's plain affine; with unbiased data processing, as for networks of COCO's
17 joints, a person's feet are off by 1.2 % of the crop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from physic_networks.networks import WEIGHTS_HELP
from physic_networks.top_down import scores_to_confidence, subpixel_peaks

from .sessions import OnnxOptions
from .top_down import TopDownBackend

if TYPE_CHECKING:
    from physic_core.types import FloatArray


class VitPoseOptions(OnnxOptions):
    """Settings of ViTPose."""

    weights: str = Field("vitpose-h-wholebody", description=WEIGHTS_HELP)


class VitPose(TopDownBackend):
    """Keypoint detector by ViTPose, as in the PhySIC paper (133 joints). Its input is RGB.

    The confidence of a joint is the peak of its heatmap.
    """

    written_for = 1
    Options = VitPoseOptions
    options: VitPoseOptions
    crop_size = (256, 192)

    def decode(self, outputs: list[FloatArray]) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
        """Return the peaks in cells of the heatmaps."""
        (heatmaps,) = outputs
        cells, peaks = subpixel_peaks(heatmaps)
        return cells, scores_to_confidence(peaks), heatmaps.shape[2:]
