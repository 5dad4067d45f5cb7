"""RTMPose, RTMW and DWPose: x and y of each joint classified apart (SimCC), one person at a time.

MMPose trains these networks on RGB, and its own deployment feeds RGB. rtmlib feeds the same files BGR; who compares
with it sets ``channels = "bgr"``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from physic_core.types import Keypoints, People, UInt8Array

    from .sessions import Network

__all__ = ["RtmPose", "RtmPoseOptions"]

HEIGHT, WIDTH = 256, 192
_LINE = (None, None, None)


class RtmPoseOptions(OneGraphOptions):
    """Settings of RTMPose."""

    weights: str = Field("rtmw-l-384x288", description=WEIGHTS)
    padding: float = Field(1.25, ge=1, le=3, description="how much larger than the person's box the crop is")
    channels: Literal["rgb", "bgr"] = Field(
        "rgb", description="order in which the network sees colours; it was trained on RGB, and rtmlib feeds BGR"
    )
    full_score: float = Field(
        1.0,
        gt=0,
        description="score that stands for certainty; SimCC's scores are the heights of peaks, which may exceed 1, "
        "and are cut there",
    )
    batch: int = Field(8, ge=1, description="people a run, where the file leaves that free")


class RtmPose(OneGraph, KeypointDetector):
    """Keypoints by RTMPose and its kin: 133, 26 or 17 joints, as the file has them; it is shown RGB."""

    Options: ClassVar[type[OneGraphOptions]] = RtmPoseOptions
    options: RtmPoseOptions
    dialects: ClassVar = {
        "SimCC": Dialect(
            (Wanted("input", ("images", "image"), shape=(None, 3, None, None)),),
            (
                Wanted("simcc_x", ("x", "output_x", "output"), shape=_LINE),
                Wanted("simcc_y", ("y", "output_y"), shape=_LINE),
            ),
            by_position=True,
        ),
    }

    def attach(self, network: Network) -> None:
        """Take an open network; one whose joints are of no person is refused at once if it tells their number."""
        from .top_down import skeleton_of

        super().attach(network)
        told = self.speaking().ports.outputs["simcc_x"].shape
        if len(told) == 3 and isinstance(told[1], int):
            skeleton_of(told[1], network.name)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) and N people -> keypoints; the lower of a joint's two peaks is its confidence."""

        from physic_core.adapters.crops import crop_around_box
        from physic_core.adapters.heatmaps import scores_to_confidence, simcc_peaks
        from physic_core.types import Keypoints

        from .top_down import SKELETON_OF, fixed_or, pictures_of, run_rows, skeleton_of

        speaking = self.speaking()
        file = speaking.network.name
        if not len(people):
            told = speaking.ports.outputs["simcc_x"].shape
            count = told[1] if len(told) == 3 and isinstance(told[1], int) else 133
            return Keypoints(np.zeros((0, count, 2)), np.zeros((0, count)), SKELETON_OF[count])
        height, width = (fixed_or(s, d) for s, d in zip(speaking.shape("input")[2:], (HEIGHT, WIDTH), strict=True))
        crops = [
            crop_around_box(box, width, height, padding=self.options.padding, grid="halves") for box in people.boxes
        ]
        pictures = pictures_of(image, crops, bgr=self.options.channels == "bgr")
        along_x, along_y = run_rows(speaking, {"input": pictures}, ["simcc_x", "simcc_y"], self.options.batch)
        skeleton = skeleton_of(along_x.shape[1], file)
        split = along_x.shape[2] / width
        if along_y.shape[:2] != along_x.shape[:2] or along_y.shape[2] != split * height or split < 1:
            raise BackendError(
                f"{file} answered simcc_x {along_x.shape} and simcc_y {along_y.shape} for {width} x {height} px: as "
                "many bins a pixel along both were expected"
            )
        bins, score = simcc_peaks(along_x, along_y, split)
        points = np.stack([crop.to_photo(own) for crop, own in zip(crops, bins, strict=True)])
        return Keypoints(points, scores_to_confidence(score, self.options.full_score), skeleton)
