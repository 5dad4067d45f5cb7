"""Detect a person's hands with the two MediaPipe hand networks: 21 landmarks in pixels and in
metres.

The palm detector needs a palm that fills a large part of its input, so it gets crops around the
wrists of a known pose: upright, and rotated so that the forearm points up. The pose also gives the
person and the side of the hand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.networks.crops import RotatedSquare
from physic_embedded.networks.single_shot_detection import anchor_centers, decode_detections

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array
    from physic_embedded.networks.crops import ImagePyramid
    from physic_networks.onnx_sessions import OnnxSession


DETECTOR_SIZE = 192
LANDMARK_SIZE = 224
DETECTOR_LAYERS = ((8, 2), (16, 6))
PALM = [0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18]
"""Landmark indices of palm and first finger joints, whose box does not depend on the pose of the
fingers.
"""


@dataclass(frozen=True)
class HandLandmarks:
    """21 landmarks of one hand: wrist, then thumb, index, middle, ring and pinky from base to tip.

    Attributes:
        points: (21, 2) photo px.
        world: (21, 3) metres, x right, y down, z away from the camera, origin near the middle of
            the hand.
        presence: in [0, 1], that there is a hand.
        right: in [0, 1], that it is a right hand.
        mirror_gap: mean distance of the landmarks from those found in the mirror image, over the
            hand's size.
    """

    points: FloatArray
    world: FloatArray
    presence: float
    right: float
    mirror_gap: float

    @property
    def size(self) -> float:
        """Longer side of the landmarks' box, px."""
        return float(np.ptp(self.points, axis=0).max())


def square_from_landmarks(points: FloatArray) -> RotatedSquare:
    """Return the landmark network's input square for a hand with known landmarks (21, 2)."""
    middle = (points[[5, 13]].mean(axis=0) + points[9]) / 2
    upright = RotatedSquare.upright(np.zeros(2), 1.0, middle - points[0])
    turned = points[PALM] @ upright.rotation
    low = turned.min(axis=0)
    high = turned.max(axis=0)
    side = float((high - low).max())
    center = upright.rotation @ ((low + high) / 2 + np.array([0.0, -0.1 * (high - low)[1]]))
    return RotatedSquare(center, 2.0 * side, upright.angle)


def predict_hand_landmarks(
    session: OnnxSession, picture: ImagePyramid, square: RotatedSquare
) -> HandLandmarks:
    """Predict the landmarks of the hand in a square, averaged over the crop and its mirror image.

    Args:
        session: of ``hand_landmark_full``.
        picture: the photo.
        square: see :func:`square_from_landmarks`.
    """
    cut = picture.crop(square, LANDMARK_SIZE)
    points, world, presence, right = _run_network(session, cut)
    other, other_world, other_presence, other_right = _run_network(session, cut[:, ::-1])
    other = other * [-1.0, 1.0] + [float(LANDMARK_SIZE), 0.0]
    gap = np.linalg.norm(points - other, axis=1).mean() / max(np.ptp(points, axis=0).max(), 1e-6)
    mean_world = (world + other_world * [-1.0, 1.0, 1.0]) / 2
    return HandLandmarks(
        points=square.to_photo((points + other) / 2, LANDMARK_SIZE),
        world=np.concatenate([mean_world[:, :2] @ square.rotation.T, mean_world[:, 2:]], axis=1),
        presence=(presence + other_presence) / 2,
        right=(right + 1.0 - other_right) / 2,
        mirror_gap=float(gap),
    )


def _run_network(
    session: OnnxSession, cut: UInt8Array
) -> tuple[FloatArray, FloatArray, float, float]:
    """Run the landmark network on a crop: landmarks in crop coordinates, landmarks in metres,
    presence, right-hand score.
    """
    raw, presence, right, world = session.run(
        ["landmarks", "presence", "handedness", "world_landmarks"],
        {"image": cut[None].astype(np.float32) / 255.0},
    )
    points = raw[0].reshape(21, 3).astype(float)
    return (
        points[:, :2],
        world[0].reshape(21, 3).astype(float),
        float(presence[0, 0]),
        float(right[0, 0]),
    )


_LEAST_PALM = 0.4  # score


def find_hand(
    detector: OnnxSession,
    landmarker: OnnxSession,
    picture: ImagePyramid,
    search_square: RotatedSquare,
    wrist: FloatArray,
    side: str,
) -> HandLandmarks | None:
    """Detect the hand at a wrist and return its landmarks, or None.

    Args:
        detector: session of ``palm_detection_full``.
        landmarker: session of ``hand_landmark_full``.
        picture: the photo.
        search_square: where to look, turned so that the forearm points up.
        wrist: (2,) of the pose, px.
        side: "left" or "right"; of two hands at one wrist, the one of this side is taken.
    """
    starts = []
    for view in (replace(search_square, angle=0.0), search_square):
        starts += _palm_squares(detector, picture, view)
    # No palm is visible: the pose gives the place of the hand.
    starts.append(replace(search_square, side=search_square.side / 1.5))
    best = None
    best_presence = 0.0
    for start in starts:
        points, _, presence, right = _run_network(landmarker, picture.crop(start, LANDMARK_SIZE))
        points = start.to_photo(points, LANDMARK_SIZE)
        worth = presence * (0.2 + (right if side == "right" else 1.0 - right))
        near = np.linalg.norm(points[0] - wrist) < 0.25 * search_square.side
        if near and worth > best_presence:
            best = square_from_landmarks(points)
            best_presence = worth
    return None if best is None else predict_hand_landmarks(landmarker, picture, best)


def _palm_squares(
    detector: OnnxSession, picture: ImagePyramid, view: RotatedSquare
) -> list[RotatedSquare]:
    """Return the landmark network's input squares for the two best palms in a square.

    Wrist -> base of the middle finger points up; half a palm towards the fingers, 2.6 palms wide.
    """
    cut = picture.crop(view, DETECTOR_SIZE)
    boxes, scores = detector.run(
        ["boxes", "scores"], {"image": cut[None].astype(np.float32) / 255.0}
    )
    anchors = anchor_centers(DETECTOR_SIZE, DETECTOR_LAYERS)
    palms = decode_detections(boxes[0], scores[0, :, 0], anchors, DETECTOR_SIZE, _LEAST_PALM)
    squares = []
    for palm in palms[:2]:
        center = view.to_photo((palm.box[:2] + palm.box[2:]) / 2, DETECTOR_SIZE)
        length = (
            max(palm.box[2] - palm.box[0], palm.box[3] - palm.box[1]) * view.side / DETECTOR_SIZE
        )
        keys = view.to_photo(palm.keypoints, DETECTOR_SIZE)
        box = np.concatenate([center - length / 2, center + length / 2])
        side = float(max(box[2] - box[0], box[3] - box[1]))
        turned = RotatedSquare.upright((box[:2] + box[2:]) / 2, 2.6 * side, keys[2] - keys[0])
        ahead = turned.rotation @ np.array([0.0, -0.5 * side])
        squares.append(replace(turned, center=turned.center + ahead))
    return squares
