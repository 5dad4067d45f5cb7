"""A body as capsules about its bones: what tells limbs that pass through the own body, or through other people.

Capsules lie inside the skin. They are round where bodies are not, so what they tell is rough: a few centimetres.
Metres throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, SIDES
from physic_core.body.model import BodyModel

__all__ = ["SEGMENTS", "Capsules", "Segment", "between_people", "fit_capsules", "segment_distance", "within_bodies"]


@dataclass(frozen=True)
class Segment:
    """A capsule's axis, and the parts whose surface gives its radius. An end is the middle of its joints."""

    name: str
    start: tuple[str, ...]
    end: tuple[str, ...]
    parts: tuple[str, ...]


def _limb(name: str, start: str, end: str) -> tuple[Segment, ...]:
    return tuple(Segment(f"{s}_{name}", (f"{s}_{start}",), (f"{s}_{end}",), (f"{s}_{name}",)) for s in SIDES)


SEGMENTS: tuple[Segment, ...] = (
    *_limb("upper_arm", "shoulder", "elbow"),
    *_limb("lower_arm", "elbow", "wrist"),
    *_limb("hand", "wrist", "middle1"),
    *_limb("upper_leg", "hip", "knee"),
    *_limb("lower_leg", "knee", "ankle"),
    *_limb("foot", "ankle", "foot"),
    Segment("hips", ("left_hip",), ("right_hip",), ("torso",)),
    Segment("waist", ("pelvis",), ("spine3",), ("torso",)),
    Segment("chest", ("spine3",), ("neck",), ("torso",)),
    Segment("shoulders", ("left_shoulder",), ("right_shoulder",), ("torso",)),
    Segment("head", ("head",), ("left_eye", "right_eye"), ("head",)),
)
"""Twelve limb segments, four of the trunk, and the head."""

_TRUNK = ("hips", "waist", "chest", "shoulders")
_INSIDE = {"torso": 0.3, "head": 0.3, "left_hand": 0.2, "right_hand": 0.2, "left_foot": 0.3, "right_foot": 0.3}
"""Share of a part's surface that may lie nearer to the axis than the radius; half of it on arms and legs."""
_TOUCHING_M = 1e-4  # axes nearer than this have no direction to be pushed apart in


@dataclass(frozen=True)
class Capsules:
    """Of B people, K each.

    Attributes:
        joints: (K, 2, 2) int64, the two joints whose middle is an end.
        radius: (B, K) metres.
        pairs: (P, 2) int64, capsules of one body that may meet.
        allowed: (B, P) metres, how deep each pair may overlap: as at rest, and as at the start.
    """

    joints: Tensor
    radius: Tensor
    pairs: Tensor
    allowed: Tensor


def fit_capsules(model: BodyModel, betas: Tensor, joints: Tensor) -> Capsules:
    """Capsules of bodies of some shape.

    Args:
        model: body model.
        betas: (B, K) shape.
        joints: (B, 55, 3) metres, at the start.
    """
    rotations, _, transl = model.zero_pose(len(betas))
    rest = model(rotations, betas, transl)
    ends = _end_joints(rest.joints.device)
    a, b = _axes(rest.joints, ends)
    radius = torch.stack([_radius(model, rest.vertices, a, b, k) for k in range(len(SEGMENTS))], 1)
    pairs = _pairs(ends)
    at_rest = _overlap(rest.joints, ends, radius, pairs)
    at_start = _overlap(joints, ends, radius, pairs)
    return Capsules(ends, radius, pairs, torch.maximum(at_rest, at_start).clamp(min=0.0))


def within_bodies(joints: Tensor, capsules: Capsules, slack: float, sigma: float) -> Tensor:
    """Self-penetration, ``sum_p max(0, r_i + r_j - d_ij - allowed_p - slack)^2 / sigma^2``: (B, 55, 3) -> (B,)."""
    deep = _overlap(joints, capsules.joints, capsules.radius, capsules.pairs) - capsules.allowed - slack
    return (torch.relu(deep) / sigma).square().sum(-1)


def between_people(joints: Tensor, capsules: Capsules, slack: float, sigma: float) -> Tensor:
    """Limbs of one person inside another, ``sum_ij max(0, r_i + r_j - d_ij - slack)^2 / sigma^2`` of each two people.

    Args:
        joints: (B, 55, 3) metres.
        capsules: of the same people.
        slack: depth that is not punished, metres.
        sigma: expected error of that depth, metres.

    Returns:
        (B,), half of each two people's for either.
    """
    people = len(joints)
    first, second = torch.triu_indices(people, people, 1, device=joints.device)
    a, b = _axes(joints, capsules.joints)
    distance = segment_distance(a[first, :, None], b[first, :, None], a[second, None], b[second, None])
    deep = capsules.radius[first, :, None] + capsules.radius[second, None] - distance - slack
    half = 0.5 * (torch.relu(deep) / sigma).square().sum((-2, -1))
    return joints.new_zeros(people).index_add(0, first, half).index_add(0, second, half)


def segment_distance(a: Tensor, b: Tensor, c: Tensor, d: Tensor) -> Tensor:
    """Shortest distance of the segments a-b and c-d: (..., 3) each -> (...).

    Where on the segments the nearest points lie is found without a gradient: moving along a segment does not change
    the distance there, or the end holds it, so that the gradient is exact all the same.
    """
    with torch.no_grad():
        u, v, w = b - a, d - c, a - c
        uu, vv, uv = (u * u).sum(-1).clamp(min=1e-12), (v * v).sum(-1).clamp(min=1e-12), (u * v).sum(-1)
        uw, vw = (u * w).sum(-1), (v * w).sum(-1)
        across = (uu * vv - uv.square()).clamp(min=1e-9 * uu * vv)  # parallel segments have many nearest points
        s = ((uv * vw - uw * vv) / across).clamp(0.0, 1.0)
        t = ((uv * s + vw) / vv).clamp(0.0, 1.0)
        s = ((uv * t - uw) / uu).clamp(0.0, 1.0)[..., None]
        t = t[..., None]
    way = (a + s * (b - a)) - (c + t * (d - c))
    return way.square().sum(-1).clamp(min=_TOUCHING_M**2).sqrt()


def _end_joints(device: torch.device) -> Tensor:
    rows = [[[JOINT_INDEX[e[0]], JOINT_INDEX[e[-1]]] for e in (s.start, s.end)] for s in SEGMENTS]
    return torch.tensor(rows, dtype=torch.int64, device=device)


def _axes(joints: Tensor, ends: Tensor) -> tuple[Tensor, Tensor]:
    """(B, K, 3) start and end of each axis."""
    points = joints[:, ends].mean(3)
    return points[:, :, 0], points[:, :, 1]


def _overlap(joints: Tensor, ends: Tensor, radius: Tensor, pairs: Tensor) -> Tensor:
    """(B, P) metres, negative where apart."""
    a, b = _axes(joints, ends)
    i, j = pairs.unbind(1)
    return radius[:, i] + radius[:, j] - segment_distance(a[:, i], b[:, i], a[:, j], b[:, j])


def _pairs(ends: Tensor) -> Tensor:
    """Capsules that share no joint and are not both of the trunk."""
    kept = []
    for i, one in enumerate(SEGMENTS):
        for j in range(i + 1, len(SEGMENTS)):
            other = SEGMENTS[j]
            joined = {*one.start, *one.end} & {*other.start, *other.end}
            if not joined and not (one.name in _TRUNK and other.name in _TRUNK):
                kept.append((i, j))
    return torch.tensor(kept, dtype=torch.int64, device=ends.device)


def _radius(model: BodyModel, vertices: Tensor, a: Tensor, b: Tensor, k: int) -> Tensor:
    """(B,) distance of the surface from axis k, over the vertices of its parts that no other axis is nearer to."""
    segment = SEGMENTS[k]
    wanted = torch.tensor([name in segment.parts for name in model.part_names], device=vertices.device)
    points = vertices[:, wanted[model.part_of_vertex] & model.outer]
    rivals = [i for i, other in enumerate(SEGMENTS) if other.parts == segment.parts]
    distance = segment_distance(a[:, None, rivals], b[:, None, rivals], points[:, :, None], points[:, :, None])
    own = distance.argmin(2) == rivals.index(k)
    mine = torch.where(own, distance[:, :, rivals.index(k)], torch.inf).sort(1).values
    share = _INSIDE.get(segment.parts[0], 0.5)
    rank = (share * (own.sum(1) - 1).clamp(min=0)).round().long()
    radius: Tensor = mine.gather(1, rank[:, None])[:, 0]
    return torch.where(torch.isfinite(radius), radius, torch.zeros_like(radius))
