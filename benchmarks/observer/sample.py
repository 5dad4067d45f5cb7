"""Tokens and keypoints of the people of a picture, kept in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physic_core.backends.people import box_iou
from physic_core.files.npz import read_arrays, write_arrays
from physic_core.types import Keypoints
from physic_embedded.keypoint_detector import keypoints_from_poses
from physic_embedded.networks.crops import ImagePyramid, RotatedSquare
from physic_embedded.networks.depth_anything import patch_tokens
from physic_embedded.networks.patch_tokens import PatchTokens
from physic_embedded.networks.pose import predict_pose
from physic_embedded.networks.sessions import open_packaged_session
from physic_embedded.networks.yolox import detect_boxes
from physic_networks.pictures import Letterbox

if TYPE_CHECKING:
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

_PASSES = 3
_LEAST_IOU = 0.3  # of a pose and its box
_SAME_IOU = 0.4  # from which on a box is that of a labelled person


@dataclass(frozen=True)
class Seen:
    """What the networks saw of one picture.

    Attributes:
        tokens: of the picture.
        boxes: (N, 4) x0 y0 x1 y1 px of N people.
        keypoints: of the same people, in their boxes.
    """

    tokens: PatchTokens
    boxes: Array
    keypoints: Keypoints


@cache
def opened(graph: str) -> OnnxSession:
    """Return a session of a packaged network, opened once."""
    return open_packaged_session(graph, 1)


def see(picture: Picture, given: Sequence[Sequence[float]]) -> Seen:
    """Return tokens of a picture (H, W, 3) RGB, and a pose in each of the given boxes, and then
    in those of people who overlap them; without boxes, in that of the likeliest person.

    A pose that does not lie in its box has confidence 0.
    """
    detections = detect_boxes(opened("yolox_nano"), picture, min_score=0.3, min_tile_score=0.3)
    boxes = detections.people.boxes.astype(np.float64)
    if not given:
        boxes = boxes[:1]
    else:
        given_boxes = np.array(given, np.float64)
        overlap = box_iou(boxes, given_boxes).max(1, initial=0)
        boxes = np.concatenate([given_boxes, boxes[(overlap > 0) & (overlap < _SAME_IOU)]])
    pyramid = ImagePyramid.from_image(picture)
    poses = [pose_in_box(opened("pose_landmark_heavy"), pyramid, box) for box in boxes]
    pose_boxes = np.array([pose.mask_box for pose in poses]).reshape(-1, 4)
    lost = np.diag(box_iou(boxes, pose_boxes)) < _LEAST_IOU
    keypoints = keypoints_from_poses(poses, *picture.shape[:2])
    confidence = np.where(lost[:, None], np.float32(0), keypoints.confidence)
    tokens = patch_tokens("depth_anything_v2_vits", opened, picture, 406, 3600)
    return Seen(tokens, boxes, replace(keypoints, confidence=confidence))


def pose_in_box(session: OnnxSession, picture: ImagePyramid, box: Array) -> Pose:
    """Return the pose of the person in a box (4,) x0 y0 x1 y1 px. Where the picture cuts the box
    below, the box may be the upper half of a person: the better of both poses is taken.
    """
    x0, y0, x1, y1 = box
    side = max(x1 - x0, y1 - y0, 1.0)
    squares = [RotatedSquare(np.array([(x0 + x1) / 2, (y0 + y1) / 2]), 1.25 * side, 0.0)]
    if y1 >= picture.height - 2:
        squares.append(RotatedSquare(np.array([(x0 + x1) / 2, y1]), 2.5 * side, 0.0))
    poses = [predict_pose(session, picture, square, _PASSES) for square in squares]
    return max(poses, key=lambda pose: pose.score)


def write_seen(file: Path, seen: Seen) -> None:
    """Write what was seen of a picture; tokens in float16."""
    photo = seen.tokens.photo
    place = [photo.scale, photo.left, photo.top, *photo.inner, *photo.size]
    file.parent.mkdir(parents=True, exist_ok=True)
    assert seen.keypoints.world is not None
    write_arrays(
        file,
        {
            "grid": seen.tokens.grid.astype(np.float16),
            "place": np.array([seen.tokens.patch, *place]),
            "boxes": seen.boxes,
            "points": seen.keypoints.points,
            "confidence": seen.keypoints.confidence,
            "world": seen.keypoints.world,
        },
        stored="f",
    )


def read_seen(file: Path) -> Seen:
    """Read what :func:`write_seen` wrote."""
    with file.open("rb") as stream:
        kept = read_arrays(stream)
    patch, scale, *rest = kept["place"].tolist()
    left, top, h, w, height, width = (int(v) for v in rest)
    photo = Letterbox(scale, left, top, (h, w), (height, width))
    tokens = PatchTokens(kept["grid"].astype(np.float64), int(patch), photo)
    keypoints = Keypoints(kept["points"], kept["confidence"], "blazepose33", kept["world"])
    return Seen(tokens, kept["boxes"], keypoints)
