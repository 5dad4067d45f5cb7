"""Convert SMPL parameters to Bodies: joints 0-21 and their rotations are the same in SMPL-X.

SMPL's joints 22 and 23, the hands, are omitted: SMPL-X has no such joints, its wrists already rotate the hands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.adapters.rotations import to_rotvecs
from physic_core.body.joints import NUM_JOINTS
from physic_core.types import Bodies, BodyParameters

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Mesh

SMPL_JOINTS = 24
SHARED_JOINTS = 22
"""Number of joints that SMPL and SMPL-X have in common, in the same order: pelvis to wrists."""


def parameters_from_rotvecs(
    rotvecs: FloatArray, betas: FloatArray, transl: FloatArray, expression: FloatArray | None = None
) -> BodyParameters:
    """Build BodyParameters from rotation vectors in SMPL-X joint order, float32.

    Args:
        rotvecs: (N, 22, 3), or (N, 55, 3) with jaw, eyes and hands, radians; zero for joints without an estimate.
        betas: (N, K) shape.
        transl: (N, 3) metres.
        expression: (N, E); None for E = 0.
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
        expression=np.zeros((rows, 0), np.float32) if expression is None else np.asarray(expression, np.float32),
        transl=np.asarray(transl, np.float32).reshape(rows, 3),
    )


def bodies_from_smpl(
    rotations: FloatArray,
    betas: FloatArray,
    transl: FloatArray,
    *,
    joints: FloatArray | None = None,
    mesh: Mesh | None = None,
    observed: BoolArray | None = None,
) -> Bodies:
    """Build Bodies of the model "smpl" from SMPL parameters.

    Args:
        rotations: (N, 24, 3), (N, 72) rotation vectors in radians, or (N, 24, 3, 3) matrices, of SMPL's joints relative
            to their parents; 22 joints are also accepted.
        betas: (N, K) SMPL shape.
        transl: (N, 3) metres, added after posing.
        joints: (N, 24, 3) or (N, 22, 3) metres, camera frame, joint positions of SMPL; None if not evaluated.
        mesh: SMPL meshes, or None.
        observed: (N, 55) bool, visible joints, or None.

    Raises:
        ValueError: a shape does not match.
    """
    count = SHARED_JOINTS if np.shape(rotations)[1] in (SHARED_JOINTS, 3 * SHARED_JOINTS) else SMPL_JOINTS
    rotvecs = to_rotvecs(rotations, count)[:, :SHARED_JOINTS]
    placed = None
    if joints is not None:
        placed = np.full((len(rotvecs), NUM_JOINTS, 3), np.nan, np.float32)
        placed[:, :SHARED_JOINTS] = np.asarray(joints)[:, :SHARED_JOINTS]
    return Bodies(parameters_from_rotvecs(rotvecs, betas, transl), "smpl", observed=observed, joints=placed, mesh=mesh)


def empty_bodies(body_model: str, num_betas: int = 10) -> Bodies:
    """Return Bodies with zero rows, for an image without people."""
    none = np.zeros((0, SHARED_JOINTS, 3), np.float32)
    return Bodies(
        parameters_from_rotvecs(none, np.zeros((0, num_betas), np.float32), np.zeros((0, 3), np.float32)), body_model
    )
