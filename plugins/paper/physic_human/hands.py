"""Boxes of hands from keypoints, the user's MANO file, and the output of right-hand networks (MANO)
as Hands.

Whole-body skeletons have 21 points per hand, and the box is their bounding box. Other skeletons
have a wrist and an elbow. There the hand is assumed beyond the wrist, in the direction of the
forearm, with three quarters of its length.

Left hands are mirrored for the network. MANO orders its joints as SMPL-X does (index, middle,
pinky, ring, thumb, each from its base). Its rotation matrices are relative to the flat hand, as
here.

The published pickles need chumpy, which does not work with new versions of Python. Unpickling a
file can run any code in it. So published code gets a copy that contains only NumPy arrays.
"""

from __future__ import annotations

import os
import pickle
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import SIDES, Hands, is_finger
from physic_networks.bodies import to_rotvecs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.types import BoolArray, FloatArray, IntArray, Keypoints

_HAND_POINTS = 21
_BEYOND = 0.33
_LENGTH = 0.75
_UPPER_ARM = 0.9
"""Distance of the hand centre from the wrist, and side of its box, in forearm lengths; and the
minimum forearm length in upper-arm lengths, since a forearm that points at the camera looks short.
"""
_EDGE = 0.5
"""Offset from pixel-centre coordinates to half-open box coordinates, px."""

JOINTS_PER_HAND = 15
"""Number of finger joints of a hand, without the wrist."""


@dataclass(frozen=True)
class HandBoxes:
    """Boxes of M hands of N people, sorted by person, left before right.

    Attributes:
        person: (M,) row of the person.
        is_right: (M,) whether it is the right hand.
        boxes: (M, 4) x0 y0 x1 y1 px, half open, tight around the hand.
        confidence: (M,) in [0, 1], of the keypoints that the box is computed from.
    """

    person: IntArray
    is_right: BoolArray
    boxes: FloatArray
    confidence: FloatArray

    def __len__(self) -> int:
        return len(self.person)


def visible_hand_boxes(
    keypoints: Keypoints, *, least_confidence: float = 0.5, least_size_px: float = 16.0
) -> HandBoxes:
    """Compute the boxes of the visible hands from keypoints.

    Args:
        keypoints: of N people, in any skeleton; one without arms gives no hands.
        least_confidence: minimum of the mean over the 21 points of a hand, or of the lower one of
            wrist and elbow.
        least_size_px: minimum of the longer side, px; smaller hands are skipped.
    """
    rows: list[tuple[int, bool, FloatArray, float]] = []
    row = {name: i for i, name in enumerate(keypoints.joint_set.names)}
    for person, (points, joint_confidence) in enumerate(
        zip(keypoints.points, keypoints.confidence, strict=True)
    ):
        for side in SIDES:
            hand = _box_from_points(points, joint_confidence, row, side) or _box_from_arm(
                points, joint_confidence, row, side
            )
            if hand is None:
                continue
            box, confidence = hand
            if confidence >= least_confidence and float((box[2:] - box[:2]).max()) >= least_size_px:
                rows.append((person, side == "right", box + _EDGE, min(confidence, 1.0)))
    return HandBoxes(
        np.array([f[0] for f in rows], np.int64),
        np.array([f[1] for f in rows], bool),
        np.array([f[2] for f in rows], np.float64).reshape(-1, 4),
        np.array([f[3] for f in rows], np.float64),
    )


def _box_from_points(
    points: FloatArray, confidence: FloatArray, row: Mapping[str, int], side: str
) -> tuple[FloatArray, float] | None:
    """Return the bounding box of 21 hand keypoints and their mean confidence; None for fewer
    keypoints.
    """
    of_side = {name: i for name, i in row.items() if name.startswith(side)}
    hand = [i for name, i in of_side.items() if is_finger(name) or name == f"{side}_hand_root"]
    if len(hand) < _HAND_POINTS:
        return None
    xy = points[hand].astype(np.float64)
    return np.concatenate([xy.min(axis=0), xy.max(axis=0)]), float(confidence[hand].mean())


def _box_from_arm(
    points: FloatArray, confidence: FloatArray, row: Mapping[str, int], side: str
) -> tuple[FloatArray, float] | None:
    """Return the corners of a square box beyond the wrist, and the lower confidence of wrist and
    elbow.
    """
    names = [f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist")]
    if not all(name in row for name in names):
        return None
    shoulder, elbow, wrist = (row[name] for name in names)
    wrist_px = points[wrist].astype(np.float64)
    along = wrist_px - points[elbow]
    forearm = float(np.linalg.norm(along))
    if confidence[shoulder] > 0:
        forearm = max(forearm, _UPPER_ARM * float(np.linalg.norm(points[elbow] - points[shoulder])))
    middle = wrist_px + _BEYOND * along
    half = _LENGTH * forearm / 2
    return np.concatenate([middle - half, middle + half]), float(
        min(confidence[wrist], confidence[elbow])
    )


@contextmanager
def chumpy_free_copy(path: str | Path) -> Iterator[Path]:
    """Yield the path of a chumpy-free copy of a MANO model, for ``pickle.load(file,
    encoding="latin1")`` and smplx.

    The copy exists only inside the block, in a new folder that only the user can open. It is a
    pickle, so it is not cached. It has the name of the original, by which smplx recognises right
    hands.

    Args:
        path: the user's file, a published ``.pkl`` or ``.npz``.

    Raises:
        BodyModelError: the file is missing, has another type, is damaged, or could run code.
    """
    from physic_core.body import MANO, read_model_file

    source = Path(os.path.expanduser(path))
    arrays = {
        name: array.astype(array.dtype.newbyteorder("="), order="C")
        for name, array in read_model_file(source, MANO).items()
    }
    with tempfile.TemporaryDirectory(prefix="physic-") as folder:
        copy = Path(folder, f"{source.stem}.pkl")
        copy.write_bytes(pickle.dumps(arrays, protocol=4))
        yield copy


def empty_hands(count: int) -> Hands:
    """Return Hands of ``count`` people without a detected hand."""
    return Hands(
        np.zeros((count, 2, JOINTS_PER_HAND, 3), np.float32), np.zeros((count, 2), np.float32)
    )


def hands_from_mano(count: int, boxes: HandBoxes, fingers: FloatArray, wrists: FloatArray) -> Hands:
    """Assemble the result of a HandEstimator from M single hands.

    Args:
        count: N people.
        boxes: whose hands they are, and how sure they are.
        fingers: (M, 15, 3) rotation vectors, (M, 45), or (M, 15, 3, 3) matrices, as of right hands;
            left ones are results of mirrored images.
        wrists: (M, 3), (M, 1, 3) or (M, 1, 3, 3), rotation of the hand from the T-pose to the
            camera frame of the network's input image.

    Returns:
        Hands of N people. A hand with non-finite values counts as not detected. Of several results
        for the same hand, the most confident one is used.

    Raises:
        ValueError: the shapes do not match.
    """
    rotvecs = to_rotvecs(fingers, JOINTS_PER_HAND)
    wrist_rotvecs = to_rotvecs(wrists, 1)[:, 0]
    left = ~boxes.is_right
    rotvecs[left] = mirror_rotvecs(rotvecs[left])
    wrist_rotvecs[left] = mirror_rotvecs(wrist_rotvecs[left])
    valid = (
        np.isfinite(rotvecs).all(axis=(1, 2))
        & np.isfinite(wrist_rotvecs).all(axis=1)
        & np.isfinite(boxes.confidence)
    )
    turned = np.zeros((count, 2, 3), np.float32)
    hands = replace(empty_hands(count), wrists=turned)
    for i in np.flatnonzero(valid):
        person_and_side = (int(boxes.person[i]), int(boxes.is_right[i]))
        if boxes.confidence[i] > hands.confidence[person_and_side]:
            hands.rotvecs[person_and_side] = rotvecs[i]
            hands.confidence[person_and_side] = min(float(boxes.confidence[i]), 1.0)
            turned[person_and_side] = wrist_rotvecs[i]
    return hands


def mirror_rotvecs(rotvecs: FloatArray) -> FloatArray:
    """Mirror rotation vectors (..., 3) left to right (x -> -x): (x, y, z) becomes (x, -y, -z)."""
    out: FloatArray = rotvecs * np.array([1.0, -1.0, -1.0])
    return out
