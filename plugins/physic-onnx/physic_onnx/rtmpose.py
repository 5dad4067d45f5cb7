"""Detect keypoints with RTMPose, RTMW or DWPose, one person at a time.

The networks classify x and y separately (SimCC). MMPose trains these networks on RGB, and its own deployment feeds RGB.
rtmlib feeds the same files BGR; set ``channels = "bgr"`` to compare with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Keypoints, People, UInt8Array

    from .one_graph import LoadedGraph
    from .sessions import Network

HEIGHT, WIDTH = 256, 192
_LINE = (None, None, None)


class RtmPoseOptions(OnnxBackendOptions):
    """Settings of RTMPose."""

    weights: str = Field("rtmw-l-384x288", description=WEIGHTS_HELP)
    padding: float = Field(1.25, ge=1, le=3, description="how much larger than the person's box the crop is")
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
    batch: int = Field(8, ge=1, le=1024, description="people a run, where the file leaves that free")


class RtmPose(OnnxBackend, KeypointDetector):
    """Keypoint detector by RTMPose, RTMW or DWPose with 133, 26 or 17 joints; its input is RGB."""

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

    def match(self, network: Network) -> LoadedGraph:
        """Match an open network; raise BackendError if it states an unknown number of joints."""
        from .top_down import skeleton_name

        loaded = super().match(network)
        shape = loaded.ports.outputs["simcc_x"].shape
        if len(shape) == 3 and isinstance(shape[1], int):
            skeleton_name(shape[1], network.name)
        return loaded

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return keypoints of N people. A joint's confidence is the lower one of its peaks in x and y."""

        from physic_core.adapters.top_down import crop_around_box, scores_to_confidence
        from physic_core.types import Keypoints

        from .top_down import SKELETON_BY_JOINTS, crop_batch, run_batches, size_or_default, skeleton_name

        loaded = self.network
        file = loaded.network.name
        if not len(people):
            shape = loaded.ports.outputs["simcc_x"].shape
            count = shape[1] if len(shape) == 3 and isinstance(shape[1], int) else 133
            return Keypoints(np.zeros((0, count, 2)), np.zeros((0, count)), SKELETON_BY_JOINTS[count])
        height, width = (
            size_or_default(s, d) for s, d in zip(loaded.input_shape("input")[2:], (HEIGHT, WIDTH), strict=True)
        )
        crops = [
            crop_around_box(box, width, height, padding=self.options.padding, grid="halves") for box in people.boxes
        ]
        pictures = crop_batch(image, crops, bgr=self.options.channels == "bgr")
        along_x, along_y = run_batches(loaded, {"input": pictures}, ["simcc_x", "simcc_y"], self.options.batch)
        skeleton = skeleton_name(along_x.shape[1], file)
        split = along_x.shape[2] / width
        if along_y.shape[:2] != along_x.shape[:2] or along_y.shape[2] != split * height or split < 1:
            raise BackendError(
                f"{file} returned simcc_x {along_x.shape} and simcc_y {along_y.shape} for {width} x {height} px: as "
                "many bins a pixel along both were expected"
            )
        bins, score = simcc_peaks(along_x, along_y, split)
        points = np.stack([crop.to_photo(own) for crop, own in zip(crops, bins, strict=True)])
        return Keypoints(points, scores_to_confidence(score, self.options.full_score), skeleton)


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
