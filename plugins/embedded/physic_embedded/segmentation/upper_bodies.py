"""Look again at people of whom only the upper part is visible.

In the square of a whole body, the landmark network squeezes hips and legs into what it sees of the
upper part, with full confidence. The trunk then seems short, and leans. The face tells it: from
eyes to mouth it is about an eighth of the trunk, and a sixth of thigh or shank.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.networks.crops import ImagePyramid, RotatedSquare
from physic_embedded.networks.pose import predict_pose_above_score
from physic_embedded.segmentation.hidden_hips import HEAD, MIDDLES, squeeze_factors
from physic_embedded.segmentation.hidden_people import grey_out, without_covered_joints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import FloatArray, UInt8Array
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession


_USUAL_FACE = 0.135  # from eyes to mouth, in lengths of the trunk
_HIPS_BELOW_EYES = 1.45  # lengths of the trunk
_RADIUS = 1.85  # from hips to the end of a body, in lengths of the trunk
_LOOKS = 3  # the square grows at each
# The next four were chosen by eye on 41 looks at labelled photos.
_LEAST_SCORE = 0.7  # of the landmark network
_LARGEST_MIRROR_GAP = 0.05  # over the side of the square
_SAME_HEAD = 0.7  # mean distance of the points of two faces, in lengths from eyes to mouth
_LESS_SQUEEZED = 0.85  # of the squeeze before


def square_from_upper_half(box: FloatArray) -> RotatedSquare:
    """Return the upright square that the landmark network needs if a box (4,) is around the upper
    half of a person.
    """
    center = np.array([(box[0] + box[2] - 1) / 2, box[3]])
    return RotatedSquare(center, 2.5 * float(max(box[2] - box[0], box[3] - box[1])), 0.0)


def with_upper_bodies(
    landmarker: OnnxSession, image: UInt8Array, poses: Sequence[Pose]
) -> list[Pose]:
    """Return the poses of all people in an image (H, W, 3), those of squeezed bodies replaced by
    what the network finds in the square that fits the face, with the other people in grey.
    """
    return [
        _refined_pose(landmarker, image, pose, [*poses[:i], *poses[i + 1 :]])
        for i, pose in enumerate(poses)
    ]


def _refined_pose(
    landmarker: OnnxSession, image: UInt8Array, pose: Pose, others: Sequence[Pose]
) -> Pose:
    """Return the pose of one person, looked for again while it is squeezed and gets better."""
    if _squeeze_factor(pose) < 1:
        return pose
    picture = ImagePyramid.from_image(grey_out(image, others))
    for _ in range(_LOOKS):
        again = predict_pose_above_score(landmarker, picture, _square_from_face(pose), _LEAST_SCORE)
        if again is None or not _is_better(again, pose):
            break
        pose = without_covered_joints(again, others)
        if _squeeze_factor(pose) < 1:
            break
    return pose


def _is_better(again: Pose, pose: Pose) -> bool:
    """Return whether a second pose is of the same person, sure, and less squeezed."""
    apart = np.linalg.norm(again.points[HEAD] - pose.points[HEAD], axis=1).mean()
    return bool(
        apart < _SAME_HEAD * _face_length(pose)
        and again.mirror_gap < _LARGEST_MIRROR_GAP
        and _squeeze_factor(again) < _LESS_SQUEEZED * _squeeze_factor(pose)
    )


def _square_from_face(pose: Pose) -> RotatedSquare:
    """Return the upright square of a whole body whose face is that of a pose."""
    trunk = _face_length(pose) / _USUAL_FACE
    hips = pose.points[MIDDLES["eyes"]].mean(axis=0) + np.array([0.0, _HIPS_BELOW_EYES * trunk])
    return RotatedSquare(hips, 2.5 * _RADIUS * trunk, 0.0)


def _squeeze_factor(pose: Pose) -> float:
    return float(squeeze_factors(pose.points[None])[0])


def _face_length(pose: Pose) -> float:
    return float(
        np.linalg.norm(
            pose.points[MIDDLES["eyes"]].mean(axis=0) - pose.points[MIDDLES["mouth"]].mean(axis=0)
        )
    )
