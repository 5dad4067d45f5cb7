"""Detect candidates for people with BlazePose's own detector."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.backends.people import box_iou
from physic_embedded.networks.crops import ImagePyramid, letterbox_square
from physic_embedded.networks.single_shot_detection import (
    BoxDetection,
    anchor_centers,
    decode_detections,
)
from physic_embedded.networks.tiles import tiles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_networks.onnx_sessions import OnnxSession

    Float = NDArray[np.floating[Any]]

DETECTOR_SIZE = 224
DETECTOR_LAYERS = ((8, 2), (16, 2), (32, 6))


def detect_people(
    session: OnnxSession,
    picture: ImagePyramid,
    threshold: float,
    tile_threshold: float,
    fractions: Sequence[float],
) -> list[BoxDetection]:
    """Detect candidate people in the full photo, its tiles and their mirror images: photo px, best
    score first.

    Overlapping detections are merged. Keypoint 0 of a candidate lies between the hips, keypoint 1
    at the radius that the landmark network needs.

    Args:
        session: of ``pose_detection``.
        picture: the photo.
        threshold: lowest score in the whole photo.
        tile_threshold: lowest score in a tile.
        fractions: tile sides over the photo's long side; the short side of a photo longer than all
            of them is added.
    """
    # People fill the height of a panorama, and the whole of it shows them too small.
    short = min(picture.width, picture.height) / max(picture.width, picture.height)
    if fractions and short < min(fractions):
        fractions = [*fractions, short]
    image = _smallest_level(picture, min([1.0, *fractions]))
    h, w = image.shape[:2]
    scale = np.array([picture.width / w, picture.height / h])
    anchors = anchor_centers(DETECTOR_SIZE, DETECTOR_LAYERS)
    found: list[BoxDetection] = []
    for x, y, side, lowest in [
        (0, 0, max(h, w), threshold),
        *((*t, tile_threshold) for t in tiles(w, h, fractions)),
    ]:
        shown, square = letterbox_square(image[y : y + side, x : x + side], DETECTOR_SIZE, (x, y))
        for mirrored in (False, True):
            pixels = shown[:, ::-1] if mirrored else shown
            boxes, scores = session.run(
                ["boxes", "scores"], {"image": pixels[None].astype(np.float32) / 127.5 - 1.0}
            )
            for d in decode_detections(boxes[0], scores[0, :, 0], anchors, DETECTOR_SIZE, lowest):
                points = square.to_photo(_points_of(d, mirrored), DETECTOR_SIZE)
                points = (points + 0.5) * scale - 0.5
                found.append(BoxDetection(points[:2].ravel(), points[2:], d.score))
    return merge_candidates(found)


def _smallest_level(picture: ImagePyramid, fraction: float) -> NDArray[np.uint8]:
    """Return the smallest copy of the photo of whose long side a fraction still fills the network's
    input.
    """
    return [
        v
        for v in picture.levels
        if max(v.shape[:2]) * fraction >= DETECTOR_SIZE or v is picture.levels[0]
    ][-1]


def _points_of(found: BoxDetection, mirrored: bool) -> Float:
    """Return corners of the box and keypoints (2 + K, 2) in the input before mirroring, px."""
    points = np.concatenate([found.box.reshape(2, 2), found.keypoints])
    if mirrored:
        points[:, 0] = DETECTOR_SIZE - points[:, 0]
        points[:2, 0] = points[1::-1, 0]
    return points


_NEAR = 0.35  # of the larger radius of two bodies
_OVERLAP = 0.3  # intersection over union of two boxes


def merge_candidates(found: Sequence[BoxDetection]) -> list[BoxDetection]:
    """Merge detections of the same person and keep the best.

    Two candidates are one person if their mid hips are near, or if their boxes overlap.
    """

    def radius(d: BoxDetection) -> float:
        return float(np.linalg.norm(d.keypoints[1] - d.keypoints[0]))

    kept: list[BoxDetection] = []
    for d in sorted(found, key=lambda d: -d.score):
        if all(
            np.linalg.norm(d.keypoints[0] - k.keypoints[0]) > _NEAR * max(radius(d), radius(k))
            and box_iou(d.box[None], k.box[None])[0, 0] < _OVERLAP
            for k in kept
        ):
            kept.append(d)
    return kept
