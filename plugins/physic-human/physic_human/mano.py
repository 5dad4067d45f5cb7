"""Convert the output of right-hand networks (MANO) to Hands; left hands are mirrored for the network.

MANO orders its joints as SMPL-X does (index, middle, pinky, ring, thumb, each from its base). Its rotation matrices are
relative to the flat hand, as here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.adapters.bodies import to_rotvecs
from physic_core.types import Hands

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, IntArray

JOINTS_PER_HAND = 15
"""Number of finger joints of a hand, without the wrist."""


def empty_hands(count: int) -> Hands:
    """Return Hands of ``count`` people without a detected hand."""
    return Hands(np.zeros((count, 2, JOINTS_PER_HAND, 3), np.float32), np.zeros((count, 2), np.float32))


def hands_from_mano(
    count: int,
    person: IntArray,
    right: BoolArray,
    fingers: FloatArray,
    confidence: FloatArray,
    wrists: FloatArray | None = None,
    *,
    left_in_mirror: bool = True,
) -> Hands:
    """Assemble the result of a HandEstimator from M single hands.

    Args:
        count: N people.
        person: (M,) row of the person.
        right: (M,) whether it is the right hand.
        fingers: (M, 15, 3) rotation vectors, (M, 45), or (M, 15, 3, 3) matrices, as of right hands.
        confidence: (M,) in [0, 1].
        wrists: (M, 3), (M, 1, 3) or (M, 1, 3, 3), rotation of the hand from the T-pose to the camera frame of the
            network's input image; None if the network does not estimate it.
        left_in_mirror: whether left hands are results of mirrored images, still as right hands; False if they are
            already mirrored back.

    Returns:
        Hands of N people. A hand with non-finite values counts as not detected. Of several results for the same hand,
        the most confident one is used.

    Raises:
        ValueError: the shapes do not match.
    """
    found = len(person)
    rotvecs = to_rotvecs(np.asarray(fingers).reshape(found, *np.shape(fingers)[1:]), JOINTS_PER_HAND)
    wrist_rotvecs = None if wrists is None else _wrist_rotvecs(wrists, found)
    mirror = ~np.asarray(right, bool) & left_in_mirror
    rotvecs[mirror] = mirror_rotvecs(rotvecs[mirror])
    valid = np.isfinite(rotvecs).all(axis=(1, 2)) & np.isfinite(confidence)
    if wrist_rotvecs is not None:
        wrist_rotvecs[mirror] = mirror_rotvecs(wrist_rotvecs[mirror])
        valid &= np.isfinite(wrist_rotvecs).all(axis=1)
    none = empty_hands(count)
    out, sure = none.rotvecs, none.confidence
    turned = np.zeros((count, 2, 3), np.float32)
    for i in np.flatnonzero(valid):
        place = (int(person[i]), int(bool(right[i])))
        if confidence[i] <= sure[place]:
            continue
        out[place], sure[place] = rotvecs[i], min(float(confidence[i]), 1.0)
        if wrist_rotvecs is not None:
            turned[place] = wrist_rotvecs[i]
    return Hands(out, sure) if wrist_rotvecs is None else Hands(out, sure, turned)


def _wrist_rotvecs(wrists: FloatArray, found: int) -> FloatArray:
    """Convert wrist rotations, matrices or vectors, to rotation vectors (M, 3)."""
    given = np.asarray(wrists, np.float64)
    if given.shape == (found, 3, 3):
        given = given[:, None]
    return to_rotvecs(given, 1)[:, 0]


def mirror_rotvecs(rotvecs: FloatArray) -> FloatArray:
    """Mirror rotation vectors (..., 3) left to right (x -> -x): (x, y, z) becomes (x, -y, -z)."""
    out: FloatArray = rotvecs * np.array([1.0, -1.0, -1.0])
    return out
