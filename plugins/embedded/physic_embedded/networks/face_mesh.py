"""See in which direction a face looks, with MediaPipe's face mesh: 468 points of a face with depth.

The network needs an upright square that the face fills. Keypoints of the face give the first one,
and the points that it finds there the second. It says itself whether there is a face: it sees none
that is turned away by more than about 60 degrees.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import SIDES
from physic_embedded.networks.crops import RotatedSquare
from physic_networks.people import sigmoid

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.types import FloatArray
    from physic_embedded.networks.crops import ImagePyramid
    from physic_networks.onnx_sessions import OnnxSession


FACE_SIZE = 192
KEYPOINTS = (
    "nose",
    *(f"{side}_{name}_surface" for name in ("eye", "ear", "mouth_corner") for side in SIDES),
)
"""Names of the keypoints that give the first square."""

DEPTH_FACTOR = 1.3
"""Factor on the network's depth across the face, which is too flat for the yaw; up and down the
face it is right. See ``docs/decisions.md``.
"""

_PAIRS = ((454, 234), (263, 33), (356, 127), (291, 61), (361, 132))  # same height, left first
_FOREHEAD, _CHIN = 10, 152
_LEAST_SCORE = 0.5  # that there is a face; below, the direction is worthless
_LEAST_FIRST_SCORE = 0.1  # in the first square, which may hold only a part of the face
_MARGIN = 1.5  # side of the second square over that of the points' box


def face_square(joints: Mapping[str, FloatArray]) -> RotatedSquare:
    """Return the first square of a face from the points (2,) px of :data:`KEYPOINTS`."""
    eyes, ears, mouth = (
        np.mean([joints[f"{side}_{name}_surface"] for side in SIDES], 0)
        for name in ("eye", "ear", "mouth_corner")
    )
    nose = joints["nose"]
    tall = float(np.linalg.norm(eyes - mouth))
    left, right = (joints[f"{side}_ear_surface"] for side in SIDES)
    wide = float(np.linalg.norm(left - right))
    deep = max(float(np.linalg.norm(nose - ear)) for ear in (left, right))
    center = 0.7 * (eyes + mouth + nose) / 3 + 0.3 * ears
    return RotatedSquare.upright(center, max(4.2 * tall, 1.9 * wide, 2.4 * deep), eyes - mouth)


def predict_face_direction(
    session: OnnxSession, picture: ImagePyramid, square: RotatedSquare
) -> tuple[FloatArray, FloatArray] | None:
    """Find the face in a square of a photo.

    Args:
        session: of ``face_landmark``.
        picture: the photo.
        square: see :func:`face_square`.

    Returns:
        The middle of the face (2,) px, and the unit vector (3,) in which it looks, in the axes of a
        camera that looks straight at it (x right, y down, z away); None without a face.
    """
    points, score = _run_network(session, picture, square)
    if score < _LEAST_FIRST_SCORE:
        return None
    flat = points[:, :2]
    low, high = flat.min(0), flat.max(0)
    square = RotatedSquare.upright(
        (low + high) / 2, _MARGIN * float((high - low).max()), flat[_FOREHEAD] - flat[_CHIN]
    )
    points, score = _run_network(session, picture, square)
    if score < _LEAST_SCORE:
        return None
    return points[:, :2].mean(0), _face_direction(points)


def _run_network(
    session: OnnxSession, picture: ImagePyramid, square: RotatedSquare
) -> tuple[FloatArray, float]:
    """Return the points (468, 3) in px of the photo, z away from the camera, and the score in
    [0, 1] that there is a face.
    """
    cut = picture.crop(square, FACE_SIZE)[None].astype(np.float32) / 255
    found, score = session.run(["landmarks", "score"], {"image": cut})
    points = found.reshape(468, 3).astype(float)
    depth = points[:, 2:] * square.side / FACE_SIZE
    flat = square.to_photo(points[:, :2], FACE_SIZE)
    return np.concatenate([flat, depth], 1), float(sigmoid(score.ravel())[0])


def _face_direction(points: FloatArray) -> FloatArray:
    """Return the unit vector (3,) across the face, away from the head."""
    stretched = points * [1, 1, DEPTH_FACTOR]
    left = _unit(np.sum([_unit(stretched[a] - stretched[b]) for a, b in _PAIRS], 0))
    up = points[_FOREHEAD] - points[_CHIN]
    return np.cross(left, _unit(up - up @ left * left))


def _unit(vector: FloatArray) -> FloatArray:
    return vector / max(float(np.linalg.norm(vector)), 1e-9)
