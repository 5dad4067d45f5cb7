"""Detect candidates for people with BlazePose's own detector."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.people import box_iou
from physic_embedded.networks.crops import ImagePyramid, letterbox_square
from physic_embedded.networks.single_shot_detection import (
    OVERLAP,
    BoxDetection,
    anchor_centers,
    decode_detections,
)
from physic_embedded.networks.tiles import tiles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import FloatArray, UInt8Array
    from physic_networks.onnx_sessions import OnnxSession


DETECTOR_SIZE = 224
DETECTOR_LAYERS = ((8, 2), (16, 2), (32, 6))
AROUND = 1.6
"""Side of the square around a box, over the larger side of the box. With 1.3 two people of a rig
become one. On 110 labelled photos, four more boxes without a labelled person become people with 2,
and two more with 1.6.
"""


def detect_people(
    session: OnnxSession,
    picture: ImagePyramid,
    threshold: float,
    tile_threshold: float,
    fractions: Sequence[float],
    people_boxes: Sequence[FloatArray] = (),
) -> list[BoxDetection]:
    """Detect candidate people in the full photo, its tiles, the squares around boxes, and their
    mirror images: photo px, best score first.

    Overlapping detections are merged. Keypoint 0 of a candidate lies between the hips, keypoint 1
    at the radius that the landmark network needs.

    Args:
        session: of ``pose_detection``.
        picture: the photo.
        threshold: lowest score in the whole photo.
        tile_threshold: lowest score in a tile.
        fractions: tile sides over the photo's long side; the short side of a photo longer than all
            of them is added.
        people_boxes: boxes (4,) x0 y0 x1 y1 px of the photo, such as those where a person may be.
    """
    # People fill the height of a panorama, and the whole of it shows them too small.
    short = min(picture.width, picture.height) / max(picture.width, picture.height)
    if fractions and short < min(fractions):
        fractions = [*fractions, short]
    long_side = max(picture.width, picture.height)
    windows = [
        (0.0, 0.0, float(long_side), threshold),
        *((*tile, tile_threshold) for tile in tiles(picture.width, picture.height, fractions)),
        *((*_search_square(box), tile_threshold) for box in people_boxes),
    ]
    candidates = [d for window in windows for d in _detect_in_square(session, picture, *window)]
    return merge_candidates(candidates)


def _search_square(box: FloatArray) -> tuple[float, float, float]:
    """Return the square (x, y, side) around a box (4,), px."""
    side = AROUND * float((box[2:] - box[:2]).max())
    x, y = (box[:2] + box[2:]) / 2 - side / 2
    return float(x), float(y), side


def _detect_in_square(
    session: OnnxSession, picture: ImagePyramid, x: float, y: float, side: float, lowest: float
) -> list[BoxDetection]:
    """Return the candidates of at least a score in a square of the photo, px, and in its mirror
    image.
    """
    image = _smallest_level(picture, side / max(picture.width, picture.height))
    scale = np.array([picture.width / image.shape[1], picture.height / image.shape[0]])
    x0, y0 = (max(0, round(v / s)) for v, s in zip((x, y), scale, strict=True))
    x1, y1 = (round((v + side) / s) for v, s in zip((x, y), scale, strict=True))
    network_image, square = letterbox_square(image[y0:y1, x0:x1], DETECTOR_SIZE, (x0, y0))
    anchors = anchor_centers(DETECTOR_SIZE, DETECTOR_LAYERS)
    detections = []
    for mirrored in (False, True):
        pixels = network_image[:, ::-1] if mirrored else network_image
        boxes, scores = session.run(
            ["boxes", "scores"], {"image": pixels[None].astype(np.float32) / 127.5 - 1.0}
        )
        for d in decode_detections(boxes[0], scores[0, :, 0], anchors, DETECTOR_SIZE, lowest):
            points = square.to_photo(_box_and_keypoints(d, mirrored), DETECTOR_SIZE)
            points = (points + 0.5) * scale - 0.5
            detections.append(BoxDetection(points[:2].ravel(), points[2:], d.score))
    return detections


def _smallest_level(picture: ImagePyramid, fraction: float) -> UInt8Array:
    """Return the smallest copy of the photo of whose long side a fraction still fills the network's
    input.
    """
    return [
        v
        for v in picture.levels
        if max(v.shape[:2]) * fraction >= DETECTOR_SIZE or v is picture.levels[0]
    ][-1]


def _box_and_keypoints(detection: BoxDetection, mirrored: bool) -> FloatArray:
    """Return corners of the box and keypoints (2 + K, 2) in the input before mirroring, px."""
    points = np.concatenate([detection.box.reshape(2, 2), detection.keypoints])
    if mirrored:
        points[:, 0] = DETECTOR_SIZE - points[:, 0]
        points[:2, 0] = points[1::-1, 0]
    return points


_NEAR = 0.35  # of the larger radius of two bodies


def merge_candidates(candidates: Sequence[BoxDetection]) -> list[BoxDetection]:
    """Merge detections of the same person and keep the best.

    Two candidates are one person if their mid hips are near, or if their boxes overlap.
    """

    def radius(d: BoxDetection) -> float:
        return float(np.linalg.norm(d.keypoints[1] - d.keypoints[0]))

    kept: list[BoxDetection] = []
    for d in sorted(candidates, key=lambda d: -d.score):
        if all(
            np.linalg.norm(d.keypoints[0] - k.keypoints[0]) > _NEAR * max(radius(d), radius(k))
            and box_iou(d.box[None], k.box[None])[0, 0] < OVERLAP
            for k in kept
        ):
            kept.append(d)
    return kept
