"""RTMO: boxes and 17 joints of all people at once, then given to the people whom the segmenter found."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray, Keypoints, People, UInt8Array

    from .sessions import Network

__all__ = ["Rtmo", "RtmoOptions", "assigned"]

SIDE = 640
GREY = 114  # around the photo
_SKELETON = "coco17"
_JOINTS = 17


class RtmoOptions(OneGraphOptions):
    """Settings of RTMO."""

    weights: str = Field("rtmo-l", description=WEIGHTS)
    least_score: float = Field(0.1, ge=0, le=1, description="score of a pose below which it is nobody's")
    least_iou: float = Field(
        0.3, ge=0, le=1, description="overlap with a person's box below which a pose is not that person's"
    )


class Rtmo(OneGraph, KeypointDetector):
    """Keypoints by RTMO; it is shown BGR from 0 to 255, as it was trained.

    Who gets no pose has confidence 0 everywhere.
    """

    Options: ClassVar[type[OneGraphOptions]] = RtmoOptions
    options: RtmoOptions
    dialects: ClassVar = {
        "mmdeploy": Dialect(
            (Wanted("input", ("images", "image"), shape=(None, 3, None, None)),),
            (
                Wanted("dets", ("boxes",), shape=(None, None, 5)),
                Wanted("keypoints", ("poses",), shape=(None, None, None, 3)),
            ),
            by_position=True,
        ),
    }

    def attach(self, network: Network) -> None:
        """Take an open network; one of another joint set is refused at once if it tells the number of its joints."""
        super().attach(network)
        told = self.speaking().ports.outputs["keypoints"].shape
        if len(told) == 4:
            _check_joints(told[2], network.name)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) and N people -> the pose whose box overlaps a person's most, each given once."""

        from physic_core.adapters.heatmaps import scores_to_confidence
        from physic_core.adapters.pictures import letterbox, normalized_nchw
        from physic_core.types import Keypoints

        from .top_down import fixed_or

        speaking = self.speaking()
        middles = (people.boxes[:, :2] + people.boxes[:, 2:] - 1) / 2
        points = np.repeat(middles[:, None], _JOINTS, axis=1)
        confidence = np.zeros((len(people), _JOINTS))
        if not len(people):
            return Keypoints(points, confidence, _SKELETON)
        height, width = (fixed_or(side, SIDE) for side in speaking.shape("input")[2:])
        canvas, place = letterbox(image, height, width, fill=GREY, where="top-left")
        dets, poses = speaking.ask("input", normalized_nchw(canvas[..., ::-1], scale=1.0), "dets", "keypoints")
        if dets.ndim != 3 or poses.ndim != 4 or dets.shape[1] != poses.shape[1]:
            raise BackendError(
                f"{speaking.network.name} answered dets {dets.shape} and keypoints {poses.shape}: "
                "(1, N, 5) and (1, N, 17, 3) were expected"
            )
        _check_joints(poses.shape[2], speaking.network.name)
        found = np.flatnonzero(dets[0, :, 4] >= self.options.least_score)
        boxes = place.edges_to_photo(dets[0, found, :4])
        whose = assigned(people.boxes, boxes, self.options.least_iou)
        for person, pose in enumerate(whose):
            if pose >= 0:
                own = poses[0, found[pose]]
                points[person] = place.to_photo(own[:, :2])
                confidence[person] = scores_to_confidence(own[:, 2])
        return Keypoints(points, confidence, _SKELETON)


def assigned(people: FloatArray, poses: FloatArray, least_iou: float) -> IntArray:
    """Which pose is whose, so that boxes overlap most in all.

    Args:
        people: (N, 4) boxes.
        poses: (M, 4) boxes.
        least_iou: below it nothing is assigned.

    Returns:
        (N,) row of the pose, or -1.
    """
    from scipy.optimize import linear_sum_assignment

    from physic_core.adapters.detections import box_iou

    iou = box_iou(people, poses)
    iou[iou < least_iou] = 0.0
    whose = np.full(len(people), -1)
    for person, pose in zip(*linear_sum_assignment(-iou), strict=True):
        if iou[person, pose] > 0:
            whose[person] = pose
    return whose


def _check_joints(count: int | str, file: str) -> None:
    if isinstance(count, int) and count != _JOINTS:
        raise BackendError(f"{file} answers {count} joints, and RTMO's {_JOINTS} of COCO were expected")
