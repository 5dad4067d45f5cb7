"""Distance of the final limbs from the detected keypoints, in the photo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_core.types import skeleton_named
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics, Skeleton

_LIMB_JOINTS = tuple(
    f"{side}_{name}" for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in SIDES
)
_CONFIDENT = 0.5
_FEWEST = 4
_QUANTILE = 0.9  # two joints of a dozen may be wrong


def limb_keypoint_error(
    joints: FloatArray,
    points: FloatArray,
    confidence: FloatArray,
    box: FloatArray,
    skeleton: Skeleton | str,
    camera: Intrinsics,
) -> float | None:
    """Return the 0.9 quantile of the limb joints' distances from their confident keypoints, of the box's diagonal.

    Args:
        joints: (55, 3) of the body, in the frame of the camera, metres.
        points: (J, 2) keypoints of the person, px.
        confidence: (J,) of the keypoints.
        box: (4,) of the person, px, x0 y0 x1 y1.
        skeleton: of the keypoints.
        camera: of the photo.

    Returns:
        None with fewer than four such keypoints or without a body.
    """
    names = skeleton_named(skeleton).names
    rows = [(names.index(name), JOINT_INDEX[name]) for name in _LIMB_JOINTS if name in names]
    pixels = np.asarray(joints, np.float64) @ camera.matrix.T
    diagonal = float(np.hypot(box[2] - box[0], box[3] - box[1]))
    errors = [
        float(np.linalg.norm(points[k] - pixels[j, :2] / pixels[j, 2])) for k, j in rows if confidence[k] >= _CONFIDENT
    ]
    if len(errors) < _FEWEST or not np.isfinite(errors).all() or diagonal <= 0:
        return None
    return float(np.quantile(errors, _QUANTILE, method="lower")) / diagonal
