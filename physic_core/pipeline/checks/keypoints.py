"""Distance of the final limbs from the detected keypoints, in the photo."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_core.types import skeleton_named
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Skeleton

_LIMB_JOINTS = tuple(
    f"{side}_{name}" for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in SIDES
)
_CONFIDENT = 0.5
_SHOWN = 0.3  # confidence of a joint that the photo shows; elbows and knees behind the trunk have 0.3 to 0.4
_FEWEST = 4
_QUANTILE = 0.9  # two joints of a dozen may be wrong
_WELL_PLACED = ("elbow", "wrist", "knee")  # shoulders, hips and ankles are farther inside the body than keypoints


def limb_keypoint_error(
    joints: FloatArray,
    points: FloatArray,
    confidence: FloatArray,
    box: FloatArray,
    skeleton: Skeleton | str,
    camera: Intrinsics,
) -> float | None:
    """Return the 0.9 quantile of the limb joints' distances from their confident keypoints, as a share of the box's
    diagonal.

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
    errors = list(_errors(joints, points, confidence >= _CONFIDENT, box, skeleton, camera).values())
    if len(errors) < _FEWEST or not np.isfinite(errors).all():
        return None
    return float(np.quantile(errors, _QUANTILE, method="lower"))


def worst_limb_joint(
    joints: FloatArray,
    points: FloatArray,
    confidence: FloatArray,
    box: FloatArray,
    skeleton: Skeleton | str,
    camera: Intrinsics,
    mask: BoolArray,
) -> tuple[float, str]:
    """Return the elbow, wrist or knee that is farthest from its keypoint inside the mask (H, W).

    The other arguments are those of :func:`limb_keypoint_error`.

    Returns:
        distance: as a share of the box's diagonal; NaN without such a keypoint or without a body.
        name: of the joint.
    """
    errors = _errors(joints, points, confidence >= _SHOWN, box, skeleton, camera)
    names = skeleton_named(skeleton).names
    height, width = mask.shape
    worst = (math.nan, "")
    for name, error in errors.items():
        u, v = np.round(points[names.index(name)]).astype(int)
        shown = 0 <= u < width and 0 <= v < height and mask[v, u]
        if name.endswith(_WELL_PLACED) and shown and not error <= worst[0]:
            worst = (error, name)
    return worst


def _errors(
    joints: FloatArray,
    points: FloatArray,
    chosen: BoolArray,
    box: FloatArray,
    skeleton: Skeleton | str,
    camera: Intrinsics,
) -> dict[str, float]:
    """Return the distances of the limb joints from the selected keypoints (J,) bool, as a share of the box's
    diagonal."""
    names = skeleton_named(skeleton).names
    rows = {name: names.index(name) for name in _LIMB_JOINTS if name in names}
    pixels = np.asarray(joints, np.float64) @ camera.matrix.T
    diagonal = float(np.hypot(box[2] - box[0], box[3] - box[1]))
    if diagonal <= 0:
        return {}
    return {
        name: float(np.linalg.norm(points[k] - pixels[JOINT_INDEX[name], :2] / pixels[JOINT_INDEX[name], 2])) / diagonal
        for name, k in rows.items()
        if chosen[k]
    }
