"""Detect the 33 BlazePose joints of people found by a segmenter."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.interfaces import KeypointDetector, Options
from physic_core.types import Keypoints
from physic_embedded.networks.blazepose import BLAZEPOSE_SKELETON
from physic_embedded.networks.crops import ImagePyramid, RotatedSquare
from physic_embedded.networks.pose import person_square, predict_pose
from physic_embedded.networks.pose_detection import detect_people
from physic_embedded.networks.sessions import PackagedBackend
from physic_embedded.segmentation.hidden_hips import lower_confidence_of_hidden_hips
from physic_embedded.segmentation.people import LEAST_FIT
from physic_embedded.segmentation.rotated_people import best_pose_of_turned_squares, square_around
from physic_networks.onnx_sessions import select_provider
from physic_networks.runtime import onnxruntime

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import BoolArray, FloatArray, People, UInt8Array
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession

_LOWEST_SCORE = 0.1  # of the detector, from which a candidate in a person's box is tried


class EmbeddedKeypointsOptions(Options):
    """Settings of :class:`EmbeddedKeypoints`."""

    threads: int = Field(
        default=2,
        ge=0,
        le=256,
        description="Threads of an operator; 0: one for each core of the process.",
    )


class EmbeddedKeypoints(PackagedBackend, KeypointDetector):
    """Keypoint detector with BlazePose heavy: skeleton "blazepose33" with world landmarks.

    People of the embedded segmenter carry these joints already. For people of another segmenter,
    the pose that lies best on the person's mask is looked for in the neighbourhood of the box.
    """

    written_for = 1
    weights_license = "Apache-2.0 (MediaPipe BlazePose)"
    Options = EmbeddedKeypointsOptions
    options: EmbeddedKeypointsOptions

    networks = ("pose_detection", "pose_landmark_heavy")

    def build(self, device: str) -> dict[str, OnnxSession]:
        """Check the device; the two networks are opened for the first people without joints."""
        select_provider("auto", device, onnxruntime().get_available_providers())
        return {}

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return 33 joints of each of N people; confidence is 0 for a person without a detected
        pose.
        """
        segmenter_keypoints = people.keypoints
        if (
            segmenter_keypoints is not None
            and segmenter_keypoints.skeleton == BLAZEPOSE_SKELETON
            and len(segmenter_keypoints.points) == len(people)
        ):
            return segmenter_keypoints
        if not self.network:
            self._network = super().build(self.device)
        picture = ImagePyramid.from_image(image)
        poses_and_fits = [
            self._best_pose(picture, mask, box)
            for mask, box in zip(people.masks, people.boxes, strict=True)
        ]
        detected = keypoints_from_poses([pose for pose, _ in poses_and_fits], *image.shape[:2])
        is_lost = np.array([fit < LEAST_FIT for _, fit in poses_and_fits], bool)
        detected = replace(
            detected, confidence=np.where(is_lost[:, None], np.float32(0), detected.confidence)
        )
        return lower_confidence_of_hidden_hips(detected, people.masks)

    def _best_pose(
        self, picture: ImagePyramid, mask: BoolArray, box: FloatArray
    ) -> tuple[Pose, float]:
        """Return the pose that fits a person's mask best, and its fit."""
        box = np.asarray(box, float)
        x0, y0, x1, y1 = box
        center = np.array([(x0 + x1 - 1) / 2, (y0 + y1 - 1) / 2])
        side = max(x1 - x0, y1 - y0, 1.0)
        # A whole body around the middle of the box, if the detector finds none there.
        starts = [(square_around(box), 3)]
        if y1 >= picture.height - 1:
            # The photo cuts the person off below: the box may be the upper half.
            starts.append((RotatedSquare(np.array([center[0], y1]), 2.5 * side, 0.0), 2))
        left, top = np.maximum(np.floor(center - side), 0).astype(int)
        right, bottom = np.ceil(center + side).astype(int) + 1
        near = picture.levels[0][top:bottom, left:right]
        detector = self.network["pose_detection"]
        pyramid = ImagePyramid.from_image(near)
        for d in detect_people(detector, pyramid, _LOWEST_SCORE, _LOWEST_SCORE, ())[:3]:
            hip, end = d.keypoints[:2] + np.array([left, top])
            starts.append((person_square(hip, end), 2))
        network = self.network["pose_landmark_heavy"]
        looks = [predict_pose(network, picture, square, passes) for square, passes in starts]
        best = max(looks, key=lambda pose: _mask_fit(pose, mask))
        pose = best_pose_of_turned_squares(
            network, picture, box, best, lambda one: _mask_fit(one, mask)
        )
        return pose, _mask_fit(pose, mask)


def keypoints_from_poses(poses: Sequence[Pose], height: int, width: int) -> Keypoints:
    """Convert poses to keypoints; confidence is 0 outside the image."""
    return Keypoints(
        points=np.array([p.points for p in poses], np.float32).reshape(-1, 33, 2),
        confidence=np.array([p.confidence(width, height) for p in poses], np.float32).reshape(
            -1, 33
        ),
        skeleton=BLAZEPOSE_SKELETON,
        world=np.array([p.world for p in poses], np.float32).reshape(-1, 33, 3),
        world_spread=np.array([p.world_spread for p in poses], np.float32).reshape(-1, 33),
    )


def _mask_fit(pose: Pose, mask: BoolArray) -> float:
    """Return how well a pose fits a mask (H, W): presence times overlap of the pose's own mask with
    it.
    """
    ys, xs = np.nonzero(mask)
    if not len(xs):
        return pose.score
    step = max(1, int(max(np.ptp(xs), np.ptp(ys)) / 96))
    pad = int(0.25 * max(np.ptp(xs), np.ptp(ys)))
    y, x = (
        np.arange(max(0, at.min() - pad), min(size, at.max() + pad + 1), step)
        for at, size in zip((ys, xs), mask.shape, strict=True)
    )
    own = pose.mask_on_grid(x, y) > 0
    given = mask[np.ix_(y, x)]
    return float(pose.score * (own & given).sum() / max((own | given).sum(), 1))
