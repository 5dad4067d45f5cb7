"""Fit the 15 finger rotations of a body model to 21 hand landmarks.

Bones of different hands differ in length, so their directions are matched, not their ends: the
palm's attitude and the angles of a hand's own degrees of freedom (flexion, some spread, hardly any
twist) are fitted by least squares within the range of human joints, from a start in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from physic_core.types import FloatArray


FINGERS = ((5, 6, 7, 8), (9, 10, 11, 12), (17, 18, 19, 20), (13, 14, 15, 16), (1, 2, 3, 4))
"""Landmark indices of index, middle, pinky, ring and thumb from base to tip: the order of SMPL-X's
hand joints.
"""
FINGER_BASES = [5, 9, 13, 17]

FLEX = 0
SPREAD = 1
TWIST = 2
_FINGER_LIMITS = (
    (0, FLEX, -30, 95, 15, 50),
    (0, SPREAD, -25, 25, 0, 10),
    (0, TWIST, -10, 10, 0, 4),
    (1, FLEX, -5, 110, 20, 50),
    (2, FLEX, -10, 85, 12, 40),
)
_THUMB_LIMITS = (
    (0, FLEX, -45, 50, 0, 25),
    (0, SPREAD, -45, 45, 0, 25),
    (0, TWIST, -35, 35, 0, 15),
    (1, FLEX, -20, 65, 5, 30),
    (1, SPREAD, -12, 12, 0, 6),
    (2, FLEX, -25, 85, 5, 40),
)
"""Joint, axis, lowest, highest, usual angle and its spread (degrees) of each degree of freedom.

The ranges are those of textbooks on the hand, rounded; the usual hand is half open.
"""
DIRECTION_SIGMA = 0.12
"""Standard deviation of the landmark network's bone directions, radians."""


@dataclass(frozen=True)
class RestHand:
    """Bone directions and joint axes of a hand in the rest pose.

    Attributes:
        bones: (5, 3, 3) unit directions of each finger's three bones.
        palm: (4, 3) unit directions from the wrist to the bases of index, middle, ring and pinky.
        axes: (5, 3, 3, 3) for each joint the unit axes of flexion towards the palm, of spread, of
            twist, in rows.
    """

    bones: FloatArray
    palm: FloatArray
    axes: FloatArray

    @classmethod
    def from_landmarks(cls, points: FloatArray, palm_down: FloatArray) -> RestHand:
        """Compute the rest directions from (21, 3) landmarks of a body in rest pose and the normal
        of its palm.
        """
        chains = points[np.array(FINGERS)]
        bones = _normalise(np.diff(chains, axis=1))
        inward = np.tile(palm_down, (5, 3, 1))
        # A thumb does not bend towards the palm's normal but across the palm.
        inward[4] = points[17] - chains[4, 1:2]
        flexion = _normalise(np.cross(bones, inward))
        return cls(
            bones,
            _normalise(points[FINGER_BASES] - points[0]),
            np.stack([flexion, np.cross(flexion, bones), bones], axis=2),
        )


def fit_fingers(landmarks: FloatArray, rest: RestHand) -> FloatArray:
    """Fit finger rotations to (21, 3) hand landmarks in any unit, in a right-handed frame.

    Args:
        landmarks: wrist, then thumb, index, middle, ring and pinky from base to tip.
        rest: of the hand of the same side.

    Returns:
        Rotation vectors (15, 3), radians: index, middle, pinky, ring, thumb, each from base to tip.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    bones = _normalise(np.diff(landmarks[np.array(FINGERS)], axis=1))
    palm = _normalise(landmarks[FINGER_BASES] - landmarks[0])
    start = Rotation.align_vectors(palm, rest.palm)[0].as_matrix()
    joints, low, high, usual, spread = _degrees_of_freedom()

    def residuals(x: FloatArray) -> FloatArray:
        """Return the residuals (P, R) of palm rotation and angles (P, 29)."""
        root = Rotation.from_rotvec(x[:, :3]).as_matrix() @ start
        b = _bone_directions(root, _rotvecs(x[:, 3:], rest, joints), rest)
        p = rest.palm @ root.transpose(0, 2, 1)
        return np.concatenate(
            [
                ((b - bones) / DIRECTION_SIGMA).reshape(len(x), -1),
                ((p - palm) / DIRECTION_SIGMA).reshape(len(x), -1),
                (x[:, 3:] - usual) / spread,
            ],
            axis=1,
        )

    inner = 1e-3
    first = np.clip(_initial_angles(bones, palm, start, rest, joints), low + inner, high - inner)
    wide = np.full(3, np.pi)
    solution = least_squares(
        lambda x: residuals(x[None])[0],
        np.concatenate([np.zeros(3), first]),
        jac=lambda x: _jacobian(residuals, x),
        bounds=(np.concatenate([-wide, low]), np.concatenate([wide, high])),
        max_nfev=30,
        ftol=1e-5,
        xtol=1e-5,
    ).x[None]
    return np.asarray(_rotvecs(solution[:, 3:], rest, joints)[0])


def _jacobian(residuals: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    """Return the Jacobian (R, U) at unknowns (U,) by forward differences, in one call."""
    step = 1e-6
    ahead = residuals(np.concatenate([x[None], x + step * np.eye(len(x))]))
    columns: FloatArray = (ahead[1:] - ahead[0]).T / step
    return columns


def _rotvecs(angles: FloatArray, rest: RestHand, joints: NDArray[np.intp]) -> FloatArray:
    """Convert angles (P, 26) of degrees of freedom (26,) to rotation vectors (P, 15, 3)."""
    turned = angles[..., None] * rest.axes.reshape(45, 3)[joints]
    out = np.zeros((len(angles), 15, 3))
    np.add.at(out, (slice(None), joints // 3), turned)  # type: ignore[arg-type]  # a slice is an index
    return out


def _bone_directions(root: FloatArray, rotvecs: FloatArray, rest: RestHand) -> FloatArray:
    """Return the directions (P, 5, 3, 3) of bones of hands with palm rotations (P, 3, 3) and
    rotation vectors (P, 15, 3).
    """
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(-1, 5, 3, 3, 3)
    first = root[:, None] @ turns[:, :, 0]
    second = first @ turns[:, :, 1]
    chain = np.stack([first, second, second @ turns[:, :, 2]], axis=2)
    return (chain @ rest.bones[..., None])[..., 0]


def _degrees_of_freedom() -> tuple[
    NDArray[np.intp], FloatArray, FloatArray, FloatArray, FloatArray
]:
    """Return index in (15 joints x 3 axes), lower and upper limit, mean and sigma (radians) of the
    26 finger angles.
    """
    table = [
        ((3 * finger + joint) * 3 + axis, *np.radians(limits))
        for finger in range(5)
        for joint, axis, *limits in (_THUMB_LIMITS if finger == 4 else _FINGER_LIMITS)
    ]
    rows, *columns = zip(*table, strict=True)
    low, high, usual, spread = (np.array(c, float) for c in columns)
    return np.array(rows, np.intp), low, high, usual, spread


def _initial_angles(
    bones: FloatArray, palm: FloatArray, root: FloatArray, rest: RestHand, joints: NDArray[np.intp]
) -> FloatArray:
    """Return a closed-form estimate of the finger angles: the swing of each bone relative to its
    parent bone.
    """
    from scipy.spatial.transform import Rotation

    turns = np.zeros((5, 3, 3))
    for finger in range(5):
        frame = root
        for joint in range(3):
            bone_direction = frame.T @ bones[finger, joint]
            resting = rest.bones[finger, joint]
            axis = np.cross(resting, bone_direction)
            sine = np.linalg.norm(axis)
            swing = axis / max(sine, 1e-9) * np.arctan2(sine, resting @ bone_direction)
            turns[finger, joint] = rest.axes[finger, joint] @ swing
            frame = frame @ Rotation.from_rotvec(swing).as_matrix()
    return turns.reshape(45)[joints]


def _normalise(v: FloatArray) -> FloatArray:
    """Scale vectors to unit length."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9))
