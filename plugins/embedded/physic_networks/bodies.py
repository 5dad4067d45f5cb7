"""Convert the output of body networks (SMPL, MHR) to Bodies, and keypoints to the joints that are
visible.

Joints 0-21 of SMPL and SMPL-X and their rotations are the same. SMPL's joints 22 and 23, the hands,
are omitted: SMPL-X has no such joints, its wrists already rotate the hands. MHR bodies (SAM 3D
Body) have 70 keypoints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from physic_core.body import FINGER_JOINTS, JOINT_INDEX, NUM_JOINTS, joint_pair
from physic_core.types import SIDES, Bodies, BodyParameters, is_finger

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from physic_core.types import BoolArray, FloatArray, Keypoints, Mesh


SMPL_JOINTS = 24

SHARED_JOINTS = 22
"""Number of joints that SMPL and SMPL-X have in common, in the same order: pelvis to wrists."""

MHR_KEYPOINTS = 70
_LIMBS = {name: joint_pair(name) for name in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")}


def to_rotvecs(rotations: FloatArray, joints: int) -> FloatArray:
    """Convert rotation matrices or vectors to rotation vectors (N, joints, 3) float64, radians.

    Args:
        rotations: (N, joints, 3) or (N, 3 joints) rotation vectors, or (N, joints, 3, 3) matrices,
            approximately orthonormal. Non-finite or invalid rotations become NaN.
        joints: number of joints; it distinguishes matrices of one joint from vectors of three.

    Raises:
        ValueError: another shape.
    """
    from scipy.spatial.transform import Rotation

    rotations_array = np.asarray(rotations, np.float64)
    rows = len(rotations_array)
    if rotations_array.shape in {(rows, joints, 3), (rows, 3 * joints)}:
        return rotations_array.reshape(rows, joints, 3).copy()
    if rotations_array.shape != (rows, joints, 3, 3):
        raise ValueError(
            f"rotations of {joints} joints must be (N, {joints}, 3), (N, {3 * joints}) or (N, "
            f"{joints}, 3, 3), got {rotations_array.shape}"
        )
    flat = rotations_array.reshape(-1, 3, 3)
    out = np.full((len(flat), 3), np.nan)
    valid: BoolArray = np.asarray(np.isfinite(flat).all(axis=(1, 2)))
    valid[valid] = np.linalg.det(flat[valid]) > 1e-3  # a reflection or a collapse is not a rotation
    if valid.any():
        out[valid] = Rotation.from_matrix(flat[valid]).as_rotvec()
    return out.reshape(rows, joints, 3)


def parameters_from_rotvecs(
    rotvecs: FloatArray, betas: FloatArray, transl: FloatArray
) -> BodyParameters:
    """Build BodyParameters from rotation vectors in SMPL-X joint order, float32.

    Args:
        rotvecs: (N, 22, 3), or (N, 55, 3) with jaw, eyes and hands, radians; zero for joints
            without an estimate.
        betas: (N, K) shape.
        transl: (N, 3) metres.
    """
    rows = len(rotvecs)
    full = np.zeros((rows, NUM_JOINTS, 3), np.float32)
    full[:, : rotvecs.shape[1]] = rotvecs

    def flat(first: int, last: int) -> FloatArray:
        return full[:, first:last].reshape(rows, 3 * (last - first))

    return BodyParameters(
        global_orient=flat(0, 1),
        body_pose=flat(1, 22),
        jaw_pose=flat(22, 23),
        leye_pose=flat(23, 24),
        reye_pose=flat(24, 25),
        left_hand_pose=flat(25, 40),
        right_hand_pose=flat(40, 55),
        betas=np.asarray(betas, np.float32),
        expression=np.zeros((rows, 0), np.float32),
        transl=np.asarray(transl, np.float32).reshape(rows, 3),
    )


def bodies_from_smpl(
    rotvecs: FloatArray,
    betas: FloatArray,
    transl: FloatArray,
    *,
    joints: FloatArray | None = None,
    mesh: Mesh | None = None,
) -> Bodies:
    """Build Bodies of the model "smpl" from SMPL parameters.

    Args:
        rotvecs: (N, 24, 3) rotation vectors, radians, of SMPL's joints relative to their parents;
            :func:`to_rotvecs` converts matrices.
        betas: (N, K) SMPL shape.
        transl: (N, 3) metres, added after posing.
        joints: (N, 24, 3) metres, camera frame, joint positions of SMPL; None if not evaluated.
        mesh: SMPL meshes, or None.
    """
    placed = None
    if joints is not None:
        placed = np.full((len(rotvecs), NUM_JOINTS, 3), np.nan, np.float32)
        placed[:, :SHARED_JOINTS] = np.asarray(joints)[:, :SHARED_JOINTS]
    return Bodies(
        parameters_from_rotvecs(rotvecs[:, :SHARED_JOINTS], betas, transl),
        "smpl",
        joints=placed,
        mesh=mesh,
    )


def empty_bodies(body_model: str, num_betas: int = 10) -> Bodies:
    """Return Bodies with zero rows, for an image without people."""
    none = np.zeros((0, SHARED_JOINTS, 3), np.float32)
    return Bodies(
        parameters_from_rotvecs(
            none, np.zeros((0, num_betas), np.float32), np.zeros((0, 3), np.float32)
        ),
        body_model,
    )


_BODY = {"shoulder": 5, "elbow": 7, "hip": 9, "knee": 11, "ankle": 13}
"""First of the two keypoints, left then right, of what both bodies have."""
_EYES = {"left_eye": 1, "right_eye": 2}
_WRIST = {"left": 62, "right": 41}
_FIRST_FINGER = {"left": 42, "right": 21}
_FINGER_NAMES = ("thumb", "index", "middle", "ring", "pinky")


def _joints_of_keypoints() -> dict[int, int]:
    """Return the SMPL-X joint of each keypoint that has one.

    Fingers are sorted from the thumb, each from its tip: tip, "first", "second", "third joint". The
    third is the knuckle, SMPL-X's first. The neck is omitted because it is another point; so are
    olecranon, fossa and acromion.
    """
    table = {number: JOINT_INDEX[name] for name, number in _EYES.items()}
    for name, number in _BODY.items():
        table |= {number: JOINT_INDEX[f"left_{name}"], number + 1: JOINT_INDEX[f"right_{name}"]}
    for side, first in _FIRST_FINGER.items():
        table[_WRIST[side]] = JOINT_INDEX[f"{side}_wrist"]
        for i, finger in enumerate(_FINGER_NAMES):
            tip = first + 4 * i
            table |= {tip + 4 - k: JOINT_INDEX[f"{side}_{finger}{k}"] for k in (1, 2, 3)}
    return table


JOINT_BY_KEYPOINT = _joints_of_keypoints()
"""SMPL-X joint by MHR keypoint."""

_FOOT = {"left": (13, 15, 16), "right": (14, 18, 19)}
"""Keypoints of the ankle and the tips of the big and the small toe, whose weighted mean is the ball
of the foot.
"""

_BALL = np.array([0.2, 0.4, 0.4], np.float32)
"""Weights of that mean: on worlds it is 5 mm off on average, and 31 mm with bent toes."""


def joints_from_mhr70(keypoints: FloatArray) -> FloatArray:
    """Convert keypoints (N, 70, 3) to SMPL-X joints (N, 55, 3) float32; NaN for joints without a
    keypoint.
    """
    joints = np.full((len(keypoints), NUM_JOINTS, 3), np.nan, np.float32)
    joints[:, list(JOINT_BY_KEYPOINT.values())] = keypoints[:, list(JOINT_BY_KEYPOINT)]
    for side, points in _FOOT.items():
        joints[:, JOINT_INDEX[f"{side}_foot"]] = np.einsum(
            "k,nki->ni", _BALL, keypoints[:, list(points)]
        )
    return joints


SeenConfidence = Annotated[
    float,
    Field(
        ge=0,
        le=1,
        description="minimum confidence of a keypoint whose joint counts as visible; 0 takes all",
    ),
]
"""Type of a backend's option ``seen_confidence``, the argument ``least`` of
:func:`observed_joints`.
"""

_PELVIS = JOINT_INDEX["pelvis"]
_CHEST = JOINT_INDEX["spine3"]
_LOWER_SPINE = [JOINT_INDEX[name] for name in ("spine1", "spine2")]
_FACE = [JOINT_INDEX[name] for name in ("neck", "head", "jaw", "left_eye", "right_eye")]
_FACE_POINTS = ("nose", *(f"{side}_{name}_surface" for side in SIDES for name in ("eye", "ear")))


def observed_joints(
    keypoints: Keypoints, height: int, width: int, least: float = 0.5, finger_share: float = 0.5
) -> BoolArray | None:
    """Return which SMPL-X joints have confident keypoints inside the image.

    Joints without a keypoint depend on other joints: collars on shoulders; the foot's joint on heel
    or toes; neck, head, jaw and eyes on nose, eyes or ears; the pelvis on a hip, the chest on a
    shoulder, the spine between them on both; fingers on a share of the hand's points and the wrist,
    or only on the wrist.

    Args:
        keypoints: of N people.
        height: of the image, px.
        width: of the image, px.
        least: minimum confidence of a visible keypoint.
        finger_share: minimum share of a hand's points that are visible if its fingers are; 0 uses
            only the wrist.

    Returns:
        (N, 55) bool, or None if the skeleton lacks a shoulder, elbow, wrist, hip, knee or ankle.
    """
    row = {name: i for i, name in enumerate(keypoints.joint_set.names)}
    if not all(f"{side}_{joint}" in row for joint in _LIMBS for side in SIDES):
        return None
    inside = (keypoints.points > -0.5) & (keypoints.points < np.array([width, height]) - 0.5)
    is_visible: BoolArray = np.asarray(inside.all(axis=-1) & (keypoints.confidence >= least))
    observed = _observed_limbs(is_visible, row, finger_share)
    shoulders, hips = (observed[:, _LIMBS[name]].any(axis=1) for name in ("shoulder", "hip"))
    observed[:, _FACE] = _columns_of(_FACE_POINTS, is_visible, row).any(axis=1, keepdims=True)
    observed[:, _PELVIS] = hips
    observed[:, _CHEST] = shoulders
    observed[:, _LOWER_SPINE] = np.asarray(hips & shoulders)[:, None]
    return observed


_FEET = joint_pair("foot")
_COLLARS = joint_pair("collar")
_FINGERS = [[joint for finger in hand for joint in finger] for hand in FINGER_JOINTS]
_FOOT_POINTS = ("big_toe", "small_toe", "heel", "foot_tip")


def _observed_limbs(
    is_visible: BoolArray, row: Mapping[str, int], finger_share: float
) -> BoolArray:
    """Return which joints (N, 55) of arms, legs, hands and feet are visible, from the visible
    keypoints (N, J) and the row of each name.
    """
    observed: BoolArray = np.zeros((len(is_visible), NUM_JOINTS), bool)
    for k, side in enumerate(SIDES):
        for joint, pair in _LIMBS.items():
            observed[:, pair[k]] = is_visible[:, row[f"{side}_{joint}"]]
        wrist, ankle, shoulder = (
            observed[:, _LIMBS[name][k]] for name in ("wrist", "ankle", "shoulder")
        )
        foot = _columns_of((f"{side}_{name}" for name in _FOOT_POINTS), is_visible, row)
        side_names = (name for name in row if name.startswith(side))
        hand = _columns_of(
            (n for n in side_names if is_finger(n) or "hand_root" in n), is_visible, row
        )
        share = hand.mean(axis=1, keepdims=True) if hand.shape[1] else np.ones((len(is_visible), 1))
        observed[:, _FEET[k]] = foot.any(axis=1) if foot.shape[1] else ankle
        observed[:, _COLLARS[k]] = shoulder
        observed[:, _FINGERS[k]] = np.logical_and(wrist[:, None], share >= finger_share)
    return observed


def _columns_of(names: Iterable[str], is_visible: BoolArray, row: Mapping[str, int]) -> BoolArray:
    """Return the columns of the names that the skeleton has."""
    return is_visible[:, [row[name] for name in names if name in row]]
