"""Find the joints of a body that are visible in the photo, from keypoints.

Body networks also return a pose for hidden limbs, without marking it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Keypoints

__all__ = ["observed_joints"]


@dataclass(frozen=True)
class _Rows:
    """Rows of a skeleton's keypoints, left then right.

    Attributes:
        limbs: shoulder, elbow, wrist, hip, knee, ankle.
        feet: heel and toes; empty if the skeleton has none.
        face: nose, eyes and ears.
        hands: the points of a hand; empty if the skeleton has none.
    """

    limbs: Mapping[str, tuple[int, int]]
    feet: tuple[tuple[int, ...], tuple[int, ...]]
    face: tuple[int, ...]
    hands: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())


_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_COCO = {name: (5 + 2 * i, 6 + 2 * i) for i, name in enumerate(_LIMBS)}
_BLAZEPOSE = dict(zip(_LIMBS, ((11, 12), (13, 14), (15, 16), (23, 24), (25, 26), (27, 28)), strict=True))
_FACE, _NO_FEET, _COCO_FEET = (0, 1, 2, 3, 4), ((), ()), ((17, 18, 19), (20, 21, 22))
_SKELETONS: Mapping[str, _Rows] = {
    "coco17": _Rows(_COCO, _NO_FEET, _FACE),
    "coco23": _Rows(_COCO, _COCO_FEET, _FACE),
    "coco_wholebody133": _Rows(_COCO, _COCO_FEET, _FACE, (tuple(range(91, 112)), tuple(range(112, 133)))),
    "halpe26": _Rows(_COCO, ((20, 22, 24), (21, 23, 25)), _FACE),
    "blazepose33": _Rows(_BLAZEPOSE, ((29, 31), (30, 32)), (0, 2, 5, 7, 8), ((17, 19, 21), (18, 20, 22))),
}
_JOINTS = 55
# Joints of SMPL-X: left, right.
_OF_LIMB = {
    "shoulder": (16, 17),
    "elbow": (18, 19),
    "wrist": (20, 21),
    "hip": (1, 2),
    "knee": (4, 5),
    "ankle": (7, 8),
}
_FEET, _COLLARS, _HANDS = (10, 11), (13, 14), (slice(25, 40), slice(40, 55))
_PELVIS, _LOWER_SPINE, _CHEST, _OF_FACE = 0, (3, 6), 9, (12, 15, 22, 23, 24)


def observed_joints(keypoints: Keypoints, height: int, width: int, least: float = 0.5) -> BoolArray | None:
    """SMPL-X joints whose keypoints are confident and inside the image.

    Joints without a keypoint depend on their neighbours: collars on shoulders; the foot's joint on heel or toes; neck,
    head, jaw and eyes on any point of the face; the pelvis on a hip, the chest on a shoulder, the spine between them on
    both; fingers on half of the hand's points, or on the wrist.

    Args:
        keypoints: of N people.
        height: of the image, px.
        width: of the image, px.
        least: minimum confidence of a visible keypoint.

    Returns:
        (N, 55) bool, or None if the skeleton is not supported.
    """
    import numpy as np

    rows = _SKELETONS.get(keypoints.skeleton)
    if rows is None:
        return None
    inside = (keypoints.points > -0.5) & (keypoints.points < np.array([width, height]) - 0.5)
    seen: BoolArray = np.asarray(inside.all(axis=-1) & (keypoints.confidence >= least))
    observed: BoolArray = np.zeros((len(seen), _JOINTS), bool)
    for name, points in rows.limbs.items():
        observed[:, list(_OF_LIMB[name])] = seen[:, list(points)]
    for side in (0, 1):
        wrist, ankle = observed[:, _OF_LIMB["wrist"][side]], observed[:, _OF_LIMB["ankle"][side]]
        feet, hand = list(rows.feet[side]), list(rows.hands[side])
        observed[:, _FEET[side]] = seen[:, feet].any(axis=1) if feet else ankle
        observed[:, _COLLARS[side]] = observed[:, _OF_LIMB["shoulder"][side]]
        fingers = seen[:, hand].mean(axis=1) >= 0.5 if hand else wrist
        observed[:, _HANDS[side]] = np.asarray(fingers & wrist)[:, None]
    shoulders, hips = (observed[:, list(_OF_LIMB[name])].any(axis=1) for name in ("shoulder", "hip"))
    observed[:, list(_OF_FACE)] = np.asarray(seen[:, list(rows.face)].any(axis=1))[:, None]
    observed[:, _PELVIS], observed[:, _CHEST] = hips, shoulders
    observed[:, list(_LOWER_SPINE)] = np.asarray(hips & shoulders)[:, None]
    return observed
