"""Where limbs are beside the own body and other people, by keypoints: numbers that tell what they
touch.

A distance d is told as exp(-d^2 / 2 r^2), which is 0 where a keypoint is not known.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import SIDES

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Keypoints

_REACH = 0.25  # of a trunk's length, of distances in the picture
_REACH_M = 0.12  # of distances of 3D keypoints
_REACHES_OF_OTHERS = (0.1, 0.3)  # of a trunk's length
_SAME_POSE = 0.25  # of a trunk's length: median distance of the joints of one person
_LEAST_TRUNK = 0.2  # of the height of the box
_FINGERS = 0.4  # of the way from the elbow to the middle of the hand, beyond it
_REACH_OF_FINGERS = 0.12  # of a trunk's length

_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_BONES = (
    *((f"{side}_{one}", f"{side}_{other}") for side in SIDES for one, other in (
        ("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "hand"),
        ("shoulder", "hip"), ("hip", "knee"), ("knee", "ankle"),
    )),
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("left_shoulder", "right_hip"),
    ("right_shoulder", "left_hip"),
    ("nose", "neck"),
)  # fmt: skip
_NEAR_FINGERS = (("same_shoulder", "same_hip"), ("same_hip", "same_knee"),
        ("same_hip", "other_hip"), ("other_shoulder", "other_elbow"))  # fmt: skip
_OWN = ("other_hand", "nose", "belly", *(f"{side}_{joint}" for side in ("same", "other")
        for joint in ("shoulder", "elbow", "hip", "knee", "ankle")))  # fmt: skip


def joint_positions(keypoints: Keypoints) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return name of a joint -> (N, 2) px, and -> (N, 3) metres from the hips; NaN where the
    skeleton lacks it, or has no 3D keypoints. "hand" is the middle of wrist and knuckles, and
    "fingers" lie beyond it, where the forearm points.
    """
    names = keypoints.joint_set.names
    world = keypoints.world
    shape = keypoints.points.shape[:2]
    positions = []
    for points in (keypoints.points, np.full((*shape, 3), np.nan) if world is None else world):
        points = np.asarray(points, np.float64)

        def middle(*wanted: str, points: FloatArray = points) -> FloatArray:
            known = [names.index(name) for name in wanted if name in names]
            if not known:
                return np.full((len(points), points.shape[2]), np.nan)
            return np.asarray(points[:, known].mean(1))

        by_name = {
            f"{side}_{joint}": middle(f"{side}_{joint}") for side in SIDES for joint in _JOINTS
        }
        for side in SIDES:
            by_name[f"{side}_hand"] = middle(
                *(f"{side}_{one}" for one in ("wrist", "pinky1", "index1"))
            )
            hand, elbow = by_name[f"{side}_hand"], by_name[f"{side}_elbow"]
            by_name[f"{side}_fingers"] = hand + _FINGERS * (hand - elbow)
        by_name["nose"] = middle("nose")
        by_name["neck"] = middle("left_shoulder", "right_shoulder")
        by_name["hips"] = middle("left_hip", "right_hip")
        by_name["belly"] = (by_name["neck"] + 2 * by_name["hips"]) / 3
        positions.append(by_name)
    return positions[0], positions[1]


def trunk_px(at: dict[str, FloatArray], boxes: FloatArray) -> FloatArray:
    """Return the length (N,) of trunks in the picture, or width of shoulders where that is more."""
    lengths = [
        np.linalg.norm(at["neck"] - at["hips"], axis=1),
        1.4 * np.linalg.norm(at["left_shoulder"] - at["right_shoulder"], axis=1),
        _LEAST_TRUNK * (boxes[:, 3] - boxes[:, 1]),
    ]
    return np.asarray(np.maximum(np.nanmax(lengths, axis=0), 1.0))


def limb_geometry(part: str, boxes: FloatArray, keypoints: Keypoints) -> FloatArray:
    """Return numbers (N, 2, F) that tell what the left and right hand, elbow, knee or ankle touch.

    Args:
        part: "hand", "elbow", "knee" or "ankle".
        boxes: (N, 4) x0 y0 x1 y1 px of N people.
        keypoints: of the same people.
    """
    positions_px, positions_m = joint_positions(keypoints)
    trunk = trunk_px(positions_px, boxes)
    sides = []
    for side, opposite in (SIDES, SIDES[::-1]):
        limb_px, limb_m = positions_px[f"{side}_{part}"], positions_m[f"{side}_{part}"]
        numbers = []
        for target in _OWN:
            name = _sided_name(target, side, opposite)
            if name == f"{side}_{part}":
                continue
            numbers.append(
                _nearness(np.linalg.norm(limb_px - positions_px[name], axis=1) / trunk, _REACH)
            )
            numbers.append(_nearness(np.linalg.norm(limb_m - positions_m[name], axis=1), _REACH_M))
        joints = ("shoulder", "hip", "knee", "ankle")
        heights = [
            (limb_px[:, 1] - positions_px[f"{side}_{joint}"][:, 1]) / trunk for joint in joints
        ]
        numbers += [np.tanh(np.nan_to_num(height)) for height in heights]
        numbers += [_bend_cosine(positions_m, side, *limb) for limb in (_ARM, _LEG)]
        numbers += nearness_to_others(limb_px, positions_px, trunk, boxes)
        if part == "hand":
            fingers = positions_px[f"{side}_fingers"]
            for bone in _NEAR_FINGERS:
                start, end = (positions_px[_sided_name(joint, side, opposite)] for joint in bone)
                numbers.append(
                    _nearness(_distance_to_bone(fingers, start, end) / trunk, _REACH_OF_FINGERS)
                )
            numbers += nearness_to_others(fingers, positions_px, trunk, boxes)
        sides.append(np.stack(numbers, 1))
    return np.stack(sides, 1)


def posture_geometry(boxes: FloatArray, keypoints: Keypoints) -> FloatArray:
    """Return numbers (N, 1, F) that tell what people do: arguments as for :func:`limb_geometry`."""
    at, at_m = joint_positions(keypoints)
    trunk = trunk_px(at, boxes)
    numbers = []
    for one, other in (
        ("neck", "hips"), ("hips", "knee"), ("hips", "ankle"), ("knee", "ankle"), ("hand", "ankle"),
    ):  # fmt: skip
        a, b = (np.stack([_joint(at, side, name) for side in SIDES], 1) for name in (one, other))
        down = np.nan_to_num((b - a) / trunk[:, None, None])
        sides = np.stack([np.tanh(down[..., 1]), np.tanh(np.abs(down[..., 0]))], -1)
        numbers += [sides.max(1), sides.min(1)]
    for limb in (_LEG, _ARM, ("neck", "hips", "knee")):
        bends = np.stack([_bend_cosine(at_m, side, *limb) for side in SIDES], 1)
        numbers.append(np.stack([bends.max(1), bends.min(1)], 1))
    width, height = (boxes[:, 2:] - boxes[:, :2]).T
    numbers.append(np.log(np.maximum(width, 1) / np.maximum(height, 1))[:, None])
    return np.concatenate(numbers, 1)[:, None]


_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle")


def _sided_name(name: str, side: str, opposite: str) -> str:
    """Return the name of a joint of which "same" and "other" stand for the sides."""
    return name.replace("same", side).replace("other", opposite)


def _joint(at: dict[str, FloatArray], side: str, name: str) -> FloatArray:
    """Return the places (N, 2 or 3) of a joint in the middle, or of one side."""
    return at[name] if name in at else at[f"{side}_{name}"]


def _bend_cosine(at: dict[str, FloatArray], side: str, *joints: str) -> FloatArray:
    """Return the cosine (N,) between two bones in a row; 0 where unknown."""
    a, b, c = (_joint(at, side, joint) for joint in joints)
    first, second = b - a, c - b
    size = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return np.asarray(np.nan_to_num((first * second).sum(1) / (size + 1e-9)))


def nearness_to_others(
    own: FloatArray, at: dict[str, FloatArray], trunk: FloatArray, boxes: FloatArray
) -> list[FloatArray]:
    """Return numbers (N,) each of how near places (N, 2) px are to the bones of other people, to
    their hands, and whether they are in another box.
    """
    count = len(own)
    bones = np.array([[at[a], at[b]] for a, b in _BONES]).transpose(2, 0, 1, 3)
    distance = np.full((count, count), np.inf)
    hands = np.full((count, count), np.inf)
    inside = np.zeros((count, count))
    for j in range(count):
        distance[:, j] = _distance_to_bones(own, bones[j]) / trunk[j]
        ends = np.stack([at[f"{side}_hand"][j] for side in SIDES])
        hands[:, j] = np.linalg.norm(own[:, None] - ends, axis=2).min(1) / trunk[j]
        inside[:, j] = ((own >= boxes[j, :2]) & (own < boxes[j, 2:])).all(1)
    same = _same_person(at, trunk)
    for matrix, none in ((distance, np.inf), (hands, np.inf), (inside, 0.0)):
        matrix[same] = none
    nearest, hand = (_far_if_unknown(each).min(1, initial=np.inf) for each in (distance, hands))
    near = [_nearness(nearest, reach) for reach in _REACHES_OF_OTHERS]
    return [*near, _nearness(hand, _REACHES_OF_OTHERS[0]), inside.max(1, initial=0.0)]


def _same_person(at: dict[str, FloatArray], trunk: FloatArray) -> BoolArray:
    """Return which pairs (N, N) are one person: each with itself, and boxes of one pose."""
    joints = np.stack([at[f"{side}_{joint}"] for side in SIDES for joint in _JOINTS], 1)
    gaps = np.linalg.norm(joints[:, None] - joints, axis=-1)
    apart = np.median(_far_if_unknown(gaps), axis=-1) / np.minimum(trunk[:, None], trunk)
    return (apart < _SAME_POSE) | np.eye(len(joints), dtype=bool)


def _distance_to_bones(joint_positions: FloatArray, bones: FloatArray) -> FloatArray:
    """Return the distance (N,) of places (N, 2) from the nearest of K bones (K, 2, 2), px."""
    apart = _distance_to_bone(joint_positions[:, None], bones[:, 0], bones[:, 1])
    return np.asarray(_far_if_unknown(apart).min(1))


def _distance_to_bone(place: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the distance (...) of places (..., 2) from bones between two joints (..., 2), px."""
    along = end - start
    share = ((place - start) * along).sum(-1) / ((along**2).sum(-1) + 1e-9)
    apart = place - start - np.clip(share, 0, 1)[..., None] * along
    return np.asarray(np.linalg.norm(apart, axis=-1))


def _far_if_unknown(distance: FloatArray) -> FloatArray:
    """Return distances (...) with inf for NaN."""
    return np.where(np.isnan(distance), np.inf, distance)


def _nearness(distance: FloatArray, reach: float) -> FloatArray:
    """Return exp(-d^2 / 2 r^2) of distances (N,); 0 where unknown."""
    return np.asarray(np.nan_to_num(np.exp(-0.5 * np.minimum(distance / reach, 30.0) ** 2)))
