"""Convert the output of right-hand networks (MANO) to hands; left hands are mirrored for the network.

MANO orders its joints as SMPL-X does (index, middle, pinky, ring, thumb, each from its base). Its rotation matrices are
relative to the flat hand, as here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.adapters.rotations import mirrored, rotvecs_of
from physic_core.types import Hands

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, IntArray

__all__ = ["FINGER_JOINTS", "hands_from_mano", "no_hands"]

FINGER_JOINTS = 15


def no_hands(count: int) -> Hands:
    """Result for ``count`` people without a detected hand."""
    return Hands(np.zeros((count, 2, FINGER_JOINTS, 3), np.float32), np.zeros((count, 2), np.float32))


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
    """Assemble the output of a HandEstimator from M single hands.

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
    rotvecs = rotvecs_of(np.asarray(fingers).reshape(found, *np.shape(fingers)[1:]), FINGER_JOINTS)
    whole = None if wrists is None else _of_one_joint(wrists, found)
    mirror = ~np.asarray(right, bool) & left_in_mirror
    rotvecs[mirror] = mirrored(rotvecs[mirror])
    sound = np.isfinite(rotvecs).all(axis=(1, 2)) & np.isfinite(confidence)
    if whole is not None:
        whole[mirror] = mirrored(whole[mirror])
        sound &= np.isfinite(whole).all(axis=1)
    none = no_hands(count)
    out, sure = none.rotvecs, none.confidence
    turned = np.zeros((count, 2, 3), np.float32)
    for i in np.flatnonzero(sound):
        place = (int(person[i]), int(bool(right[i])))
        if confidence[i] <= sure[place]:
            continue
        out[place], sure[place] = rotvecs[i], min(float(confidence[i]), 1.0)
        if whole is not None:
            turned[place] = whole[i]
    return Hands(out, sure) if whole is None else Hands(out, sure, turned)


def _of_one_joint(wrists: FloatArray, found: int) -> FloatArray:
    given = np.asarray(wrists, np.float64)
    if given.shape == (found, 3, 3):
        given = given[:, None]
    return rotvecs_of(given, 1)[:, 0]
