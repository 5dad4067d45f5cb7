"""Errors of the estimators of one photo against what is known of it; real photos and worlds are measured alike.

All is in the OpenCV camera frame, metres and px of the photo. NaN marks unknown values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.joints import BODY_ROWS, BONES, HIPS, LIMB_JOINTS, SHOULDERS, SIDES, bone_lengths
from physic_core.metrics import assign, pa_mpjpe_mm

from .measures import box_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.body.model import BodyModel
    from physic_core.pipeline.estimate import Estimates
    from physic_core.types import BoolArray, DepthMap, FloatArray, Keypoints, Pointmap
    from physic_testing.worlds import World

    Record = dict[str, Any]

LIMB_SETS = ("left_foot", "right_foot", "left_hand", "right_hand")
"""Contact sets of a body's limbs."""

_SEGMENTS = {f"{side}_{name}": pair for name, pairs in BONES.items() for side, pair in zip(SIDES, pairs, strict=True)}
_MIN_JOINTS = 8
_MATCH_LIMIT = 0.35  # of the box: the median joint of who is found is nearer
_SWAP_GAIN = 0.5  # a swap at least halves the error
_SWAP_SIZE = 0.06  # of the box: smaller errors are not a swap
_TILTED_DEG = 15.0  # a bone nearer to the image plane has no side to be flipped to
_TRUNK_DEPTH_M = 0.10  # skin of chest and belly before the middle of hips and shoulders
_NEAR_FLOOR_M, _FAR_FLOOR_M = 0.5, 15.0
_MIN_FLOOR_PX = 300


@dataclass(frozen=True)
class PhotoTruth:
    """What is known of a photo with N annotated people.

    Attributes:
        points: (N, 12, 2) px of LIMB_JOINTS.
        seen: (N, 12) 1 visible, 0 hidden.
        boxes: (N, 4) px x0 y0 x1 y1.
        joints: (N, 12, 3) m, or of another frame and scale if ``camera_known`` is False.
        camera_known: whether ``joints`` are in the frame of the photo's camera.
        points_known: whether ``points`` were measured; else they say only who is who.
        complete: whether everybody in the photo is annotated.
        up: (3,) unit, or None.
        camera_height: of the camera above the floor, m.
        touches: contact set of LIMB_SETS -> whether it touches, for each person.
    """

    points: FloatArray
    seen: FloatArray
    boxes: FloatArray
    joints: FloatArray
    camera_known: bool = True
    points_known: bool = True
    complete: bool = False
    up: FloatArray | None = None
    camera_height: float = math.nan
    touches: tuple[Mapping[str, bool], ...] = field(default=())


def estimator_records(estimates: Estimates, truth: PhotoTruth, model: BodyModel) -> dict[str, list[Record]]:
    """Return the records of one photo by kind: people, keypoints, bodies, segments, depth, contact."""
    points, confidence = limb_points(estimates.keypoints)
    matched = _match(points, truth)
    joints = _body_joints(estimates, model)
    records: dict[str, list[Record]] = {
        "people": [_person_record(truth, i, i in matched) for i in range(len(truth.boxes))],
        "keypoints": [],
        "bodies": [],
        "segments": [],
        "depth": [depth_record(estimates, truth, matched)],
        "contact": [],
    }
    for i, j in matched.items():
        if truth.points_known:
            records["keypoints"] += _keypoint_records(points[j], confidence[j], truth, i)
        if np.isfinite(joints[j]).all() and np.isfinite(truth.joints[i]).all(-1).sum() >= _MIN_JOINTS:
            body, segments = _body_records(joints[j], truth.joints[i], truth.seen[i], truth.camera_known)
            records["bodies"].append(body)
            records["segments"] += segments
        if i < len(truth.touches):
            probability = np.asarray(estimates.contact.probability[j])
            records["contact"] += [
                {
                    "kind": name.split("_")[1],
                    "touches": touching,
                    "share": float((probability[model.contact_sets[name].numpy()] >= 0.5).mean()),
                }
                for name, touching in truth.touches[i].items()
            ]
    return records


def world_truth(world: World, model: BodyModel) -> PhotoTruth:
    """Return what is known of a world, as of a photo of a calibrated camera with complete annotations."""
    from physic_testing.worlds.ground_truth import project

    joints = world.joints[:, BODY_ROWS].astype(np.float64)
    points = project(joints, world.intrinsics)
    touches = [
        {name: bool(world.contact[i, model.contact_sets[name].numpy()].any()) for name in LIMB_SETS}
        for i in range(len(joints))
    ]
    return PhotoTruth(
        points=points,
        seen=world.joints_visible[:, BODY_ROWS].astype(np.float64),
        boxes=np.stack([box_of(p) for p in points]),
        joints=joints,
        complete=True,
        up=np.asarray(world.floor.normal, np.float64),
        camera_height=float(world.floor.offset),
        touches=tuple(touches),
    )


def limb_points(keypoints: Keypoints) -> tuple[FloatArray, FloatArray]:
    """Return the points (N, 12, 2) px of LIMB_JOINTS and their confidence (N, 12)."""
    names = list(keypoints.joint_set.names)
    rows = [names.index(name) for name in LIMB_JOINTS]
    return keypoints.points[:, rows].astype(np.float64), keypoints.confidence[:, rows].astype(np.float64)


def _body_joints(estimates: Estimates, model: BodyModel) -> FloatArray:
    from physic_bench.worlds.evaluation import initial_estimate

    joints: FloatArray = np.asarray(initial_estimate(estimates, model, 0.5).joints, np.float64)[:, BODY_ROWS]
    return joints


def _match(points: FloatArray, truth: PhotoTruth) -> dict[int, int]:
    """Return true person -> found person, by the median distance of the joints."""
    cost = np.full((len(truth.boxes), len(points)), 9.0)
    for i, box in enumerate(truth.boxes):
        size = max(box[2] - box[0], box[3] - box[1])
        apart = np.linalg.norm(points - truth.points[i], axis=-1) / size
        if np.isfinite(truth.points[i]).any():
            # A swap of left and right is an error of the found, and no other person.
            swapped = np.linalg.norm(points[:, _OTHER_SIDE] - truth.points[i], axis=-1) / size
            cost[i] = np.minimum(np.nanmedian(apart, 1), np.nanmedian(swapped, 1))
    return assign(cost.T, cost.T < _MATCH_LIMIT).predicted_of


_OTHER_SIDE = [row ^ 1 for row in range(12)]


def _person_record(truth: PhotoTruth, i: int, found: bool) -> Record:
    known = np.isfinite(truth.points[i]).all(-1)
    return {
        "found": found,
        "complete": truth.complete,
        "joints": int(known.sum()),
        "seen_share": float(np.nan_to_num(truth.seen[i][known]).mean()) if known.any() else math.nan,
        "size_px": float((truth.boxes[i][2:] - truth.boxes[i][:2]).max()),
    }


def _keypoint_records(points: FloatArray, confidence: FloatArray, truth: PhotoTruth, i: int) -> list[Record]:
    """Return a record for each known joint, with its error along and across the trunk as a share of the box."""
    box, true = truth.boxes[i], truth.points[i]
    size = float(max(box[2] - box[0], box[3] - box[1]))
    trunk = true[SHOULDERS].mean(0) - true[HIPS].mean(0)
    up = (
        trunk / np.linalg.norm(trunk) if np.isfinite(trunk).all() and np.linalg.norm(trunk) > 0 else np.array([0, -1.0])
    )
    left = true[[0, 6]].mean(0) - true[[1, 7]].mean(0)
    across = np.array([-up[1], up[0]])
    across = across if not np.isfinite(left).all() or across @ left > 0 else -across  # towards the person's left
    swaps = {name: _is_swapped(points, true, size, rows) for name, rows in _PAIRS.items()}
    records = []
    for row, name in enumerate(LIMB_JOINTS):
        if not np.isfinite(true[row]).all():
            continue
        side, _, joint = name.partition("_")
        limb = "arms" if joint in ("elbow", "wrist") else "legs" if joint in ("knee", "ankle") else "trunk"
        error = (points[row] - true[row]) / size
        records.append(
            {
                "person": i,
                "joint": joint,
                "limb": f"{side} {limb}",
                "seen": float(truth.seen[i][row]),
                "up": float(error @ up),
                "out": float(error @ across) * (1 if side == "left" else -1),
                "error": float(np.linalg.norm(error)),
                "confidence": float(confidence[row]),
                "swapped": any(flag for key, flag in swaps.items() if flag is not None and limb == key),
                **({f"swap_{key}": flag for key, flag in swaps.items()} if row == 0 else {}),
            }
        )
    return records


_PAIRS = {"arms": (2, 3, 4, 5), "legs": (8, 9, 10, 11), "trunk": (0, 1, 6, 7)}


def _is_swapped(points: FloatArray, true: FloatArray, size: float, rows: tuple[int, ...]) -> bool | None:
    """Return whether left and right of a limb pair are swapped; None if they are too near or unknown to tell."""
    rows = tuple(r for r in rows if np.isfinite(true[[r, r ^ 1]]).all())
    if not rows or np.mean([np.linalg.norm(true[r] - true[r ^ 1]) for r in rows]) < _SWAP_SIZE * size:
        return None
    own = np.mean([np.linalg.norm(points[r] - true[r]) for r in rows])
    other = np.mean([np.linalg.norm(points[r ^ 1] - true[r]) for r in rows])
    return bool(other < _SWAP_GAIN * own and own > _SWAP_SIZE * size)


def _body_records(
    joints: FloatArray, true: FloatArray, seen: FloatArray, camera_known: bool
) -> tuple[Record, list[Record]]:
    """Return the record of one body (12, 3), and those of its limb segments."""
    known: BoolArray = np.asarray(np.isfinite(true).all(-1), bool)
    record: Record = {"pa_mpjpe_mm": float(pa_mpjpe_mm(joints, np.where(known[:, None], true, 0.0), known))}
    own, real = bone_lengths(joints), bone_lengths(true)
    both = [name for name in real if math.isfinite(real[name])]
    ratio = sum(own[name] for name in both) / sum(real[name] for name in both) if both else math.nan
    record["bones_log"] = math.log(ratio)
    trunk = [row for row in (*SHOULDERS, *HIPS) if known[row]]
    if known.all():
        record |= rotation_errors(joints, true)
    if not camera_known or len(trunk) < 3:
        return record, []
    middle, true_middle = joints[HIPS].mean(0), true[[row for row in HIPS if known[row]] or trunk].mean(0)
    sight = true_middle / np.linalg.norm(true_middle)
    right = np.cross([0.0, 1.0, 0.0], sight)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(sight, right), sight])  # right, down, away
    turn = _rotation(true[trunk], joints[trunk])
    record |= dict(zip(("turn_right", "turn_down", "turn_away"), np.degrees(axes @ turn).tolist(), strict=True))
    record |= {
        "depth_log": math.log(middle[2] / true_middle[2]),
        "lateral_mm": 1000
        * float(np.linalg.norm((middle * true_middle[2] / middle[2] - true_middle)[:2]))
        / math.sqrt(2),
    }
    segments = [
        _segment_record(name, axes @ (joints[b] - joints[a]), axes @ (true[b] - true[a]), seen[b])
        for name, (a, b) in _SEGMENTS.items()
        if known[a] and known[b]
    ]
    return record, segments


def rotation_errors(joints: FloatArray, true: FloatArray) -> dict[str, list[float]]:
    """Return the errors of rotations in degrees, which hold in any frame: by name of the joint, left and right.

    The error of a hip or shoulder is the angle between thigh or upper arm and the true one in the frame of the trunk,
    that of a knee or elbow the same in the frame of the bone before it. Rotations about the own bone do not show. That
    of the spine is the angle of shoulders and hips, each to the true ones, in the frame of the trunk.

    Args:
        joints: (12, 3) metres.
        true: (12, 3) of any frame.
    """
    from scipy.spatial.transform import Rotation

    trunk = [*SHOULDERS, *HIPS]
    turned = Rotation.from_rotvec(_rotation(joints[trunk], true[trunk])).apply(joints)
    across = [_angle_deg(turned[b] - turned[a], true[b] - true[a]) for a, b in (SHOULDERS, HIPS)]
    errors: dict[str, list[float]] = {"spine": [math.hypot(*across)]}
    for near, far, first, second in (("thigh", "shank", "hip", "knee"), ("upper_arm", "forearm", "shoulder", "elbow")):
        for (a, b), (_, c) in zip(BONES[near], BONES[far], strict=True):
            bone, end = turned[b] - turned[a], turned[c] - turned[b]
            true_bone, true_end = true[b] - true[a], true[c] - true[b]
            axis = np.cross(bone, true_bone)
            angle = _angle_deg(bone, true_bone)
            along = Rotation.from_rotvec(axis / max(float(np.linalg.norm(axis)), 1e-12) * math.radians(angle))
            errors.setdefault(first, []).append(angle)
            errors.setdefault(second, []).append(_angle_deg(along.apply(end), true_end))
    return errors


def _angle_deg(own: FloatArray, true: FloatArray) -> float:
    sine, cosine = np.linalg.norm(np.cross(own, true)), own @ true
    return float(np.degrees(np.arctan2(sine, cosine)))


def _rotation(source: FloatArray, target: FloatArray) -> FloatArray:
    """Return the rotation vector (3,) that aligns points (n, 3) best about their means."""
    from scipy.spatial.transform import Rotation

    turn, _ = Rotation.align_vectors(target - target.mean(0), source - source.mean(0))
    vector: FloatArray = turn.as_rotvec()
    return vector


def _segment_record(name: str, own: FloatArray, true: FloatArray, seen: float) -> Record:
    """Return the errors of a limb segment's direction: its angle in the image plane and its tilt in depth."""
    own, true = own / np.linalg.norm(own), true / np.linalg.norm(true)
    tilt, true_tilt = (float(np.degrees(np.arcsin(np.clip(d[2], -1, 1)))) for d in (own, true))
    cross, dot = own[0] * true[1] - own[1] * true[0], own[:2] @ true[:2]
    tilted = abs(true_tilt) > _TILTED_DEG and abs(tilt) > _TILTED_DEG
    return {
        "segment": name.split("_", 1)[1],
        "limb": f"{name.split('_')[0]} {'leg' if name.endswith(('thigh', 'shank')) else 'arm'}",
        "seen": float(seen),
        "plane_deg": float(np.degrees(np.arctan2(cross, dot))) if abs(true_tilt) < 60 else math.nan,
        "tilt_deg": tilt - true_tilt,
        "true_tilt": true_tilt,
        "size_deg": abs(tilt) - abs(true_tilt),
        "angle_deg": float(np.degrees(np.arccos(np.clip(own @ true, -1, 1)))),
        "flipped": bool(tilt * true_tilt < 0) if tilted else None,
    }


# ---- depth -----------------------------------------------------------------------------------------------------------


def depth_record(estimates: Estimates, truth: PhotoTruth, matched: Mapping[int, int]) -> Record:
    """Return the errors of the depth maps of one photo, measured on the true floor and the true trunks of people."""
    record: Record = {
        "disagreement": _disagreement(estimates),
        "stated_sigma": float(estimates.depth.scale_sigma or math.nan),
    }
    mask = estimates.people.floor
    record["floor_mask"] = bool(mask is not None and mask.mean() > 0.01)
    if truth.up is None or not truth.camera_known:
        return record
    floor = _true_floor_depth(estimates, truth)
    if mask is None or not math.isfinite(truth.camera_height):
        return record
    used = mask & ~estimates.hole & (floor > _NEAR_FLOOR_M) & (floor < _FAR_FLOOR_M)
    if used.sum() < _MIN_FLOOR_PX:
        return record
    return (
        record
        | _metric_floor(estimates.depth, used, floor, estimates, truth)
        | _relative_floor(estimates, used, floor, truth, matched)
    )


def _true_floor_depth(estimates: Estimates, truth: PhotoTruth) -> FloatArray:
    """Return the depth (H, W) of the true floor on each ray; infinite where the ray never meets it."""
    assert truth.up is not None
    fall = -(_rays(estimates) @ truth.up)
    with np.errstate(divide="ignore"):
        depth: FloatArray = np.where(fall > 1e-6, truth.camera_height / np.maximum(fall, 1e-6), np.inf)
    return depth


def _rays(estimates: Estimates) -> FloatArray:
    camera = estimates.intrinsics
    v, u = np.mgrid[: camera.height, : camera.width]
    rays: FloatArray = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1)
    return rays


def _metric_floor(
    depth: DepthMap, used: BoolArray, floor: FloatArray, estimates: Estimates, truth: PhotoTruth
) -> Record:
    """Return scale, bend and local noise of the metric depth on the floor, and the errors of its floor."""
    assert truth.up is not None
    used = used & np.isfinite(depth.depth) & (depth.depth > 0)
    own, true = depth.depth[used].astype(np.float64), floor[used]
    if len(own) < _MIN_FLOOR_PX:
        return {}
    error = np.log(own / true)
    middle = float(np.median(error))
    points = (_rays(estimates) * depth.depth[..., None])[used].astype(np.float64)
    normal, offset = _plane(points)
    normal, offset = (normal, offset) if normal @ truth.up > 0 else (-normal, -offset)
    # 1 / own = s / true + t: t is what bends the floor.
    scale, shift = _robust_line(1 / true, 1 / own)
    spread = np.ptp(np.percentile(np.log(true), [5, 95]))
    return {
        "floor_scale_log": middle,
        "floor_scale_z": middle / depth.scale_sigma if depth.scale_sigma else math.nan,
        "bend": shift * float(np.median(own)) if spread > 0.25 else math.nan,
        "floor_noise": _spread(np.log(own * (scale / true + shift))),
        "floor_angle_deg": float(np.degrees(np.arccos(np.clip(normal @ truth.up, -1, 1)))),
        "camera_height_log": math.log(offset / truth.camera_height) if offset > 0 else math.nan,
    }


def _relative_floor(
    estimates: Estimates, used: BoolArray, floor: FloatArray, truth: PhotoTruth, matched: Mapping[int, int]
) -> Record:
    """Return the local noise of the photo's point map on the floor, and the offsets of people from its depth."""
    z = estimates.original.points[..., 2].astype(np.float64)
    used = used & estimates.original.valid & (z > 0)
    if used.sum() < _MIN_FLOOR_PX:
        return {}
    scale, shift = _robust_line(1 / z[used], 1 / floor[used])
    inverse = scale / np.where(z > 0, z, np.nan) + shift
    record: Record = {"map_noise": _spread(np.log(floor[used] * inverse[used]))}
    offsets = []
    for i in matched:
        trunk, pixels = truth.joints[i][[0, 1, 6, 7]], truth.points[i][[0, 1, 6, 7]]
        if not np.isfinite(trunk).all():
            continue
        # Towards the middle of the trunk, so that no pixel misses the person.
        pixels = np.round(pixels + 0.35 * (pixels.mean(0) - pixels)).astype(int)
        height, width = z.shape
        if (pixels < 0).any() or (pixels >= [width, height]).any():
            continue
        own = 1 / inverse[pixels[:, 1], pixels[:, 0]]
        if np.isfinite(own).all() and (own > 0).all():
            offsets.append(float(np.log(np.median(own) / (trunk[:, 2].mean() - _TRUNK_DEPTH_M))))
    return record | {"person_offsets": offsets}


def _disagreement(estimates: Estimates) -> float:
    """Return the spread of log depth between the point maps of photo and inpainted photo, outside the hole."""
    one, two = _inverse_depth(estimates.original), _inverse_depth(estimates.scene)
    used = np.isfinite(one) & np.isfinite(two) & ~estimates.hole
    if used.sum() < _MIN_FLOOR_PX:
        return math.nan
    one, two = one[used], two[used]
    scale, shift = _robust_line(one, two)
    fitted = scale * one + shift
    kept = (fitted > 0.2 * np.median(two)) & (two > 0.2 * np.median(two))  # the far end says nothing of the near
    return _spread(np.log(fitted[kept] / two[kept])) if kept.sum() >= _MIN_FLOOR_PX else math.nan


def _inverse_depth(pointmap: Pointmap) -> FloatArray:
    z = pointmap.points[..., 2].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse: FloatArray = np.where(pointmap.valid & (z > 0), 1 / z, np.nan)
    return inverse


def _robust_line(x: FloatArray, y: FloatArray, most: int = 20000) -> tuple[float, float]:
    """Return a and b of y = a x + b by least squares, repeated without what is beyond 2.5 robust deviations."""
    step = max(1, len(x) // most)
    x, y = x[::step], y[::step]
    kept = np.ones(len(x), bool)
    a = b = 0.0
    for _ in range(6):
        a, b = (float(v) for v in np.polyfit(x[kept], y[kept], 1))
        rest = np.abs(y - a * x - b)
        kept = rest <= 2.5 * 1.4826 * max(float(np.median(rest)), 1e-12)
    return a, b


def _spread(values: FloatArray) -> float:
    """Return the robust standard deviation."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _plane(points: FloatArray) -> tuple[FloatArray, float]:
    """Return the unit normal (3,) and the offset of a plane through points (n, 3), fitted without outliers."""
    kept = points[:: max(1, len(points) // 20000)]
    normal = np.array([0.0, -1.0, 0.0])
    for _ in range(6):
        middle = np.median(kept, 0)
        normal = np.linalg.svd(kept - middle, full_matrices=False)[2][2]
        rest = np.abs((kept - middle) @ normal)
        kept = kept[rest <= 2.5 * 1.4826 * max(float(np.median(rest)), 1e-9)]
    return normal, float(-normal @ np.median(kept, 0))
