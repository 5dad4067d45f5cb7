"""Detect 17 joints of all people at once with RTMO, and assign the poses to the segmented people."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector, Share

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray, Keypoints, People, UInt8Array

    from .sessions import Network

SIDE = 640
GREY = 114  # around the photo
_SKELETON = "coco17"
_JOINTS = 17


class RtmoOptions(OnnxBackendOptions):
    """Settings of RTMO."""

    weights: str = Field("rtmo-l", description=WEIGHTS_HELP)
    least_score: Share = Field(0.1, description="score of a pose below which it belongs to no person")
    least_iou: Share = Field(0.3, description="overlap with a person's box below which a pose is not that person's")


class Rtmo(OnnxBackend, KeypointDetector):
    """Keypoint detector by RTMO; its input is BGR from 0 to 255, as in training.

    Who gets no pose has confidence 0 everywhere.
    """

    Options: ClassVar[type[OnnxBackendOptions]] = RtmoOptions
    options: RtmoOptions
    signatures: ClassVar = {
        "mmdeploy": GraphSignature(
            (PortSpec("input", ("images", "image"), shape=(None, 3, None, None)),),
            (
                PortSpec("dets", ("boxes",), shape=(None, None, 5)),
                PortSpec("keypoints", ("poses",), shape=(None, None, None, 3)),
            ),
            by_position=True,
        ),
    }

    def bind(self, network: Network) -> None:
        """Store an open network; raise BackendError if it states a number of joints other than 17."""
        super().bind(network)
        shape = self.loaded().ports.outputs["keypoints"].shape
        if len(shape) == 4:
            _check_joints(shape[2], network.name)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return keypoints of N people. Poses are assigned to people by box overlap, each pose at most once."""

        from physic_core.adapters.heatmaps import scores_to_confidence
        from physic_core.adapters.pictures import letterbox, normalized_nchw
        from physic_core.types import Keypoints

        from .top_down import size_or_default

        loaded = self.loaded()
        middles = (people.boxes[:, :2] + people.boxes[:, 2:] - 1) / 2
        points = np.repeat(middles[:, None], _JOINTS, axis=1)
        confidence = np.zeros((len(people), _JOINTS))
        if not len(people):
            return Keypoints(points, confidence, _SKELETON)
        height, width = (size_or_default(side, SIDE) for side in loaded.input_shape("input")[2:])
        canvas, place = letterbox(image, height, width, fill=GREY, where="top-left")
        dets, poses = loaded.run_image("input", normalized_nchw(canvas[..., ::-1], scale=1.0), "dets", "keypoints")
        if dets.ndim != 3 or poses.ndim != 4 or dets.shape[1] != poses.shape[1]:
            raise BackendError(
                f"{loaded.network.name} returned dets {dets.shape} and keypoints {poses.shape}: "
                "(1, N, 5) and (1, N, 17, 3) were expected"
            )
        _check_joints(poses.shape[2], loaded.network.name)
        found = np.flatnonzero(dets[0, :, 4] >= self.options.least_score)
        boxes = place.edges_to_photo(dets[0, found, :4])
        whose = assign_poses(people.boxes, boxes, self.options.least_iou)
        for person, pose in enumerate(whose):
            if pose >= 0:
                own = poses[0, found[pose]]
                points[person] = place.to_photo(own[:, :2])
                confidence[person] = scores_to_confidence(own[:, 2])
        return Keypoints(points, confidence, _SKELETON)


def assign_poses(people: FloatArray, poses: FloatArray, least_iou: float) -> IntArray:
    """Assign poses to people so that the total overlap of boxes is largest.

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
    """Raise BackendError if the number of joints is not 17."""
    if isinstance(count, int) and count != _JOINTS:
        raise BackendError(f"{file} returns {count} joints, and RTMO's {_JOINTS} of COCO were expected")
