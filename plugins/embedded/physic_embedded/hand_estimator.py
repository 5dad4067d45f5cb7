"""Estimate finger rotations from hand landmarks found at the wrists of known people."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.interfaces import HandEstimator, Options
from physic_core.types import SIDES, Hands
from physic_embedded.body_fit.fingers import RestHand, fit_fingers
from physic_embedded.networks.crops import ImagePyramid, RotatedSquare
from physic_embedded.networks.hand_landmarks import find_hand
from physic_embedded.networks.sessions import PackagedBackend, Threads

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Keypoints, People, UInt8Array
    from physic_embedded.networks.hand_landmarks import HandLandmarks
    from physic_networks.onnx_sessions import OnnxSession

KNUCKLES = ("index1", "middle1", "ring1", "pinky1")
_LEAST_PRESENCE = 0.7  # of a hand, as the landmark network judges
# Between landmarks and those of the mirror image, of the hand's size; clear hands have .01 to .04.
_LARGEST_GAP = 0.08
_HAND_OF_TRUNK = 0.36  # least length of a hand
_LEAST_SIZE_PX = 32  # fitted hand; below 30 px fingers are a guess


class EmbeddedHandsOptions(Options):
    """Settings of :class:`EmbeddedHands`."""

    body: str = Field(
        default="embedded",
        description="Body whose hand is fitted: 'embedded', or the path of your own SMPLX_*.npz.",
    )
    threads: Threads = 2


class EmbeddedHands(PackagedBackend, HandEstimator):
    """Hand estimator: detects MediaPipe hand landmarks near the wrist keypoints, and fits finger
    rotations to them.

    The wrist determines the side of the hand. A hand that looks like one of the other side belongs
    to another person and is not used.
    """

    written_for = 1
    weights_license = "Apache-2.0 (MediaPipe Hands)"
    Options = EmbeddedHandsOptions
    options: EmbeddedHandsOptions
    networks = ("palm_detection_full", "hand_landmark_full")

    def __init__(self, options: EmbeddedHandsOptions | None = None) -> None:
        super().__init__(options)
        self._rest: dict[str, RestHand] = {}

    def build(self, device: str) -> dict[str, OnnxSession]:
        """Open the two networks and compute the rest pose of the body's hands."""
        self._rest = _rest_hands(self.options.body)
        return super().build(device)

    def close(self) -> None:
        """Close the networks and release the body model."""
        super().close()
        self._rest = {}

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Return the finger rotations of N people; confidence is 0 for a hand without reliable
        landmarks.
        """
        rotvecs = np.zeros((len(people), 2, 15, 3), np.float32)
        confidence = np.zeros((len(people), 2), np.float32)
        detector = self.network["palm_detection_full"]
        landmarker = self.network["hand_landmark_full"]
        picture = ImagePyramid.from_image(image)
        row = {name: j for j, name in enumerate(keypoints.joint_set.names)}
        has_arms = all(
            f"{side}_{joint}" in row
            for joint in ("shoulder", "elbow", "wrist", "hip")
            for side in SIDES
        )
        for i, (points, seen) in enumerate(
            zip(keypoints.points, keypoints.confidence, strict=True)
        ):
            for s, side in enumerate(SIDES if has_arms else ()):
                around = _search_square(points, seen, row, side)
                if around is None or around.side < _LEAST_SIZE_PX:
                    continue
                wrist = points[row[f"{side}_wrist"]]
                look = find_hand(detector, landmarker, picture, around, wrist, side)
                if look is None or not self._is_reliable(look, side):
                    continue
                rotvecs[i, s] = fit_fingers(look.world, self._rest[side])
                confidence[i, s] = look.presence * (look.right if s else 1.0 - look.right)
        return Hands(rotvecs, confidence)

    def _is_reliable(self, landmarks: HandLandmarks, side: str) -> bool:
        """Return whether the landmarks of a hand are good enough to use."""
        right_side = (landmarks.right > 0.5) == (side == "right")
        steady = landmarks.mirror_gap < _LARGEST_GAP
        return (
            right_side
            and steady
            and landmarks.size >= _LEAST_SIZE_PX
            and landmarks.presence >= _LEAST_PRESENCE
        )


def _search_square(
    points: FloatArray, confidence: FloatArray, row: dict[str, int], side: str
) -> RotatedSquare | None:
    """Return the square in which to search for a hand, in which the forearm points up; None if the
    wrist is not visible.
    """
    if confidence[row[f"{side}_wrist"]] < 0.3:
        return None
    elbow, wrist = (points[row[f"{side}_{joint}"]] for joint in ("elbow", "wrist"))
    knuckles = [row[f"{side}_{name}"] for name in KNUCKLES if f"{side}_{name}" in row]
    fingers = points[knuckles].mean(axis=0) if knuckles else 1.35 * wrist - 0.35 * elbow
    left_shoulder, right_shoulder, left_hip, right_hip = (
        points[row[name]] for name in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
    )
    trunk = float(np.linalg.norm((left_shoulder + right_shoulder - left_hip - right_hip) / 2))
    hand = max(0.75 * float(np.linalg.norm(wrist - elbow)), _HAND_OF_TRUNK * trunk)
    return RotatedSquare.upright(wrist + 0.8 * (fingers - wrist), 2.6 * hand, fingers - elbow)


def _rest_hands(body: str) -> dict[str, RestHand]:
    """Return both hands of a body in its T-pose, palms down."""
    from physic_core.body import load_body

    model = load_body(body)
    output = model(*model.zero_pose())
    down = np.array([0.0, -1.0, 0.0])
    return {
        side: RestHand.from_landmarks(
            model.landmarks(output, f"openpose_hand21_{side}")[0].double().numpy(), down
        )
        for side in SIDES
    }
