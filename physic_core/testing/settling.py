"""Settles a posed body into true contact: patches of skin on the surfaces that carry them, nothing inside anything.

A fit over place, turn and the joints of trunk and limbs (L-BFGS on a thinned skin), in rounds: after each the whole
skin is measured, and what still lies inside joins the fit. The room's frame (y up), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import roma
import torch
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES
from physic_core.engine.terms import joint_limits
from physic_core.testing.solids import FLAT, Block, Ground, Solid, signed_distance
from physic_core.testing.touching import Skin, crossing_allowed, folding_parts, skin_of, vertex_normals

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["Neighbour", "Plan", "Reach", "Settled", "Touch", "depth_inside", "pose_body", "settle"]

_FREE = 22  # pelvis and the 21 joints of trunk and limbs; fingers, jaw and eyes stay as planned
_SLACK = 0.001  # metres inside that count as touching
_RANGE = 0.06  # metres within which two patches of skin are looked at
_ROUNDS = ((0.012, 0.006, 40), (0.005, 0.003, 40), (0.003, 0.0015, 60), (0.003, 0.0012, 40), (0.003, 0.0010, 40))
"""Of each round: what a gap and a depth of 1 stand for, metres, and the steps."""

_GOOD_DEPTH, _GOOD_GAP = 0.003, 0.012

# Radians by which a joint may leave its plan, about the body's x, y and z.
_LOOSE: dict[str, tuple[float, float, float]] = {
    "spine": (0.12, 0.10, 0.10),
    "neck": (0.20, 0.15, 0.15),
    "head": (0.20, 0.15, 0.15),
    "hip": (0.35, 0.25, 0.20),
    "knee": (0.40, 0.04, 0.04),
    "ankle": (0.30, 0.15, 0.20),
    "foot": (0.30, 0.02, 0.02),
    "collar": (0.06, 0.08, 0.08),
    "shoulder": (0.25, 0.25, 0.25),
    "elbow": (0.25, 0.35, 0.04),
    "wrist": (0.20, 0.30, 0.40),
}

# Mass of segments by Dempster: the joints between which each one's centre lies, the share of the way, its weight.
_MASSES = (
    ("pelvis", "neck", 0.42, 0.497),
    ("neck", "head", 1.3, 0.081),
    *((f"{s}_shoulder", f"{s}_elbow", 0.44, 0.028) for s in ("left", "right")),
    *((f"{s}_elbow", f"{s}_wrist", 0.68, 0.022) for s in ("left", "right")),
    *((f"{s}_hip", f"{s}_knee", 0.43, 0.100) for s in ("left", "right")),
    *((f"{s}_knee", f"{s}_ankle", 0.43, 0.0465) for s in ("left", "right")),
    *((f"{s}_ankle", f"{s}_foot", 0.5, 0.0145) for s in ("left", "right")),
)


@dataclass(frozen=True)
class Touch:
    """A patch of skin that shall lie on something.

    Attributes:
        patch: a key of ``Skin.patches``.
        share: of its vertices, the nearest, that shall touch.
        on: "scene", "people" or "self".
        blocks: which of the plan's blocks; empty for the ground alone, None for whatever is nearest.
        target: with "people" and "self", the patch that is touched; all skin where empty.
    """

    patch: str
    share: float
    on: str = "scene"
    blocks: tuple[int, ...] | None = None
    target: str = ""


@dataclass(frozen=True)
class Reach:
    """A patch whose middle shall come near a point; ``sigma`` metres off count as much as a joint off by its range."""

    patch: str
    point: tuple[float, float, float]
    sigma: float = 0.05


@dataclass(frozen=True)
class Plan:
    """A person before settling.

    Attributes:
        action: what they do.
        pose: (55, 3) rotation vectors, radians.
        betas: (K,).
        pelvis: (3,) where the pelvis joint is.
        blocks: furniture that the action brings.
        touches: what shall touch.
        reaches: what shall come near points.
        balanced: whether the feet alone carry the person.
        drift: metres by which the pelvis may leave its place, to the side and to the front.
        azimuth: degrees between which the camera may look, where the plan knows better than its action.
    """

    action: str
    pose: FloatArray
    betas: FloatArray
    pelvis: tuple[float, float, float]
    blocks: tuple[Block, ...] = ()
    touches: tuple[Touch, ...] = ()
    reaches: tuple[Reach, ...] = ()
    balanced: bool = False
    drift: float = 0.10
    azimuth: tuple[float, float] | None = None


@dataclass(frozen=True)
class Neighbour:
    """Another person, who does not move.

    Attributes:
        vertices: (V, 3) of the same mesh.
    """

    vertices: FloatArray


@dataclass(frozen=True)
class Settled:
    """A settled person.

    Attributes:
        pose: (55, 3).
        transl: (3,).
        depth: metres, of the deepest outer vertex inside the scene or inside another person.
        gap: metres, of the demanded touch that is missed most: mean distance of its share of vertices.
        crossing: metres, of the deepest vertex of a limb inside another part of the own body.
    """

    pose: FloatArray
    transl: FloatArray
    depth: float
    gap: float
    crossing: float

    @property
    def residual(self) -> float:
        """The larger of depth and gap."""
        return max(self.depth, self.gap)


def pose_body(
    model: BodyModel, pose: FloatArray, betas: FloatArray, transl: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pose (55, 3), betas (K,), transl (3,) -> vertices (V, 3) and joints (55, 3), in the frame of the root's turn."""

    def tensor(x: FloatArray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(x)[None], dtype=model.dtype)

    with torch.no_grad():
        output = model(roma.rotvec_to_rotmat(tensor(pose)), tensor(betas), tensor(transl))
    return output.vertices[0].numpy(), output.joints[0].numpy()


def settle(
    model: BodyModel,
    plan: Plan,
    *,
    around: Sequence[Block] = (),
    ground: Ground = FLAT,
    neighbours: Sequence[Neighbour] = (),
) -> Settled:
    """Settle one person.

    Args:
        model: in float64.
        plan: the start, and what shall touch.
        around: solid things beside the plan's own.
        ground: below everything.
        neighbours: other people.
    """
    near = [block for block in around if _within_reach(plan, block)]
    fit = _Fit(model, plan, (*plan.blocks, *near), ground, neighbours)
    x = np.zeros(fit.size)
    for number, (gap, depth, steps) in enumerate(_ROUNDS):
        fit.look_around(x, gap, depth)
        result = minimize(fit, x, jac=True, method="L-BFGS-B", options={"maxiter": steps, "maxcor": 20})
        x = result.x
        settled = fit.measure(x)
        if number >= 2 and settled.depth < _GOOD_DEPTH and settled.gap < _GOOD_GAP and settled.crossing < 0.008:
            break
    return settled


def _within_reach(plan: Plan, block: Block) -> bool:
    """Whether any part of somebody's body could get to a block."""
    away = np.linalg.norm(np.array(block.centre) - np.array(plan.pelvis))
    return bool(away < 1.5 + np.linalg.norm(block.half))


@dataclass(frozen=True)
class _Pairs:
    """Points of the posed vertices (rows) and the planes of what lies nearest: n . (v - p), row or fixed point."""

    rows: Tensor
    points: Tensor  # fixed points, or rows of the own body
    normals: Tensor
    own: bool

    @classmethod
    def of(cls, rows: NDArray[Any], points: NDArray[Any], normals: FloatArray, *, own: bool) -> _Pairs:
        """From arrays."""
        return cls(torch.as_tensor(rows), torch.as_tensor(points), torch.as_tensor(normals), own)

    def signed(self, vertices: Tensor) -> Tensor:
        points = vertices[self.points] if self.own else self.points
        return ((vertices[self.rows] - points) * self.normals).sum(-1)

    def distance(self, vertices: Tensor) -> Tensor:
        """Beside the plane only what exceeds the spacing of vertices counts."""
        points = vertices[self.points] if self.own else self.points
        apart = vertices[self.rows] - points
        signed = (apart * self.normals).sum(-1)
        aside = (apart.square().sum(-1) - signed.square()).clamp(min=1e-12).sqrt()
        return (signed.square() + torch.relu(aside - 0.02).square()).clamp(min=1e-14).sqrt()


class _Fit:
    """The energy of one plan over whitened parameters, and what has to be looked up anew now and then."""

    def __init__(
        self,
        model: BodyModel,
        plan: Plan,
        blocks: tuple[Block, ...],
        ground: Ground,
        neighbours: Sequence[Neighbour],
    ) -> None:
        self.model, self.plan, self.blocks, self.ground = model, plan, blocks, ground
        self.skin: Skin = skin_of(model)
        like = torch.zeros(0, dtype=torch.float64)
        self.solid = Solid(blocks, ground, like)
        self.columns = [self._columns(touch) for touch in plan.touches]
        self.start = roma.rotvec_to_rotmat(torch.as_tensor(plan.pose, dtype=torch.float64))
        self.betas = torch.as_tensor(plan.betas, dtype=torch.float64)[None]
        _, joints = pose_body(model, plan.pose, plan.betas, np.zeros(3))
        self.transl = torch.as_tensor(np.array(plan.pelvis) - joints[0], dtype=torch.float64)
        self.sigma = torch.as_tensor(_sigmas(plan), dtype=torch.float64)
        self.size = len(self.sigma)
        self.others = [(n.vertices, vertex_normals(n.vertices, self.skin.faces)) for n in neighbours]
        wanted = [self.skin.patches[t.patch] for t in plan.touches] + [self.skin.patches[r.patch] for r in plan.reaches]
        wanted += [self.skin.patches[t.target] for t in plan.touches if t.on == "self"]
        self.ids = np.unique(np.concatenate([self.skin.thinned, *wanted]))
        self.gap = self.depth = 0.01
        self._gather()

    def _columns(self, touch: Touch) -> list[int]:
        """Which of the distances to all blocks and to the ground a touch is about."""
        if touch.blocks is None:
            return list(range(len(self.blocks) + 1))
        return list(touch.blocks) or [len(self.blocks)]

    def _gather(self) -> None:
        """Pose only what is looked at."""
        self.posed = self.model.landmarks_only([], torch.as_tensor(self.ids))
        self.row = np.full(self.model.num_vertices, -1)
        self.row[self.ids] = np.arange(len(self.ids))
        self.touch_rows = [torch.as_tensor(self.row[self.skin.patches[t.patch]]) for t in self.plan.touches]
        self.reach_rows = [torch.as_tensor(self.row[self.skin.patches[r.patch]]) for r in self.plan.reaches]

    def _parameters(self, x: Tensor) -> tuple[Tensor, Tensor]:
        moved = x * self.sigma
        turn = roma.rotvec_to_rotmat(moved[3:].reshape(_FREE, 3))
        root = turn[:1] @ self.start[:1]
        rotations = torch.cat([root, self.start[1:_FREE] @ turn[1:], self.start[_FREE:]])
        return rotations, self.transl + moved[:3]

    def __call__(self, x: FloatArray) -> tuple[float, FloatArray]:
        free = torch.as_tensor(x).requires_grad_()
        energy = self.energy(free)
        (gradient,) = torch.autograd.grad(energy, free)
        return float(energy.detach()), gradient.numpy()

    def energy(self, free: Tensor) -> Tensor:
        """() of the whitened parameters (n,)."""
        rotations, transl = self._parameters(free)
        posed = self.posed(rotations[None], self.betas, transl[None])
        vertices, joints = posed["vertices"][0], posed["joints"][0]
        total = free.square().sum() + joint_limits(rotations[None]).sum()
        distances = self.solid.distances(vertices)
        total = total + (torch.relu(-distances.amin(-1) - _SLACK) / self.depth).square().sum()
        for pairs, slack in ((self.near_self, 0.002), (self.near_people, _SLACK)):
            if pairs is not None:
                total = total + (torch.relu(-pairs.signed(vertices) - slack) / self.depth).square().sum()
        for k, touch in enumerate(self.plan.touches):
            near = self._nearest(k, touch, vertices, distances)
            total = total + _bowl((near / self.gap).square()).mean() * 4
        for reach, rows in zip(self.plan.reaches, self.reach_rows, strict=True):
            away = vertices[rows].mean(0) - torch.as_tensor(reach.point, dtype=torch.float64)
            total = total + (away / reach.sigma).square().sum()
        if self.plan.balanced:
            total = total + (torch.relu(_imbalance(joints) - 0.02) / 0.015).square()
        return total

    def _nearest(self, k: int, touch: Touch, vertices: Tensor, distances: Tensor) -> Tensor:
        """Distances of the nearest share of a patch to what it shall touch."""
        if touch.on == "scene":
            distance = distances[self.touch_rows[k]][:, self.columns[k]].amin(-1).abs()
        else:
            distance = self.touch_pairs[k].distance(vertices)
        count = max(3, round(touch.share * len(distance)))
        return distance.topk(min(count, len(distance)), largest=False).values

    def look_around(self, x: FloatArray, gap: float, depth: float) -> None:
        """Set the scale of the terms; add vertices that lie inside; find anew what is near to what."""
        self.gap, self.depth = gap, depth
        vertices = self._whole(x)
        outer = vertices[self.skin.outer]
        inside = signed_distance(outer, self.blocks, self.ground) < -_SLACK
        for other, directions in self.others:
            distance, index = cKDTree(other).query(outer, distance_upper_bound=_RANGE)
            near = np.flatnonzero(np.isfinite(distance))
            chosen = index[near]
            inside[near] |= ((outer[near] - other[chosen]) * directions[chosen]).sum(1) < -_SLACK
        self.ids = np.union1d(self.ids, self.skin.outer[inside])
        self._gather()
        normals = vertex_normals(vertices, self.skin.faces)
        self.near_self = self._self_pairs(vertices, normals, self.ids)
        self.near_people = self._people_pairs(vertices)
        self.touch_pairs = [self._touch_pairs(touch, vertices, normals) for touch in self.plan.touches]

    def _whole(self, x: FloatArray) -> FloatArray:
        rotations, transl = self._parameters(torch.as_tensor(x))
        with torch.no_grad():
            return self.model(rotations[None], self.betas, transl[None]).vertices[0].numpy()

    def _self_pairs(self, vertices: FloatArray, normals: FloatArray, ids: NDArray[Any]) -> _Pairs | None:
        first, second = _own_pairs(self.skin, vertices, ids)
        if not len(first):
            return None
        return _Pairs.of(self.row[first], self.row[second], normals[second], own=True)

    def _people_pairs(self, vertices: FloatArray) -> _Pairs | None:
        rows, points, normals = [], [], []
        for other, directions in self.others:
            distance, index = cKDTree(other[self.skin.outer]).query(vertices[self.ids], distance_upper_bound=_RANGE)
            near = np.flatnonzero(np.isfinite(distance))
            chosen = self.skin.outer[index[near]]
            rows.append(near)
            points.append(other[chosen])
            normals.append(directions[chosen])
        if not rows or not sum(len(r) for r in rows):
            return None
        return _Pairs.of(*(np.concatenate(a) for a in (rows, points, normals)), own=False)

    def _touch_pairs(self, touch: Touch, vertices: FloatArray, normals: FloatArray) -> Any:
        if touch.on == "scene":
            return None
        patch = self.skin.patches[touch.patch]
        if touch.on == "self":
            target = self.skin.patches[touch.target]
            _, index = cKDTree(vertices[target]).query(vertices[patch])
            chosen = target[index]
            return _Pairs.of(self.row[patch], self.row[chosen], normals[chosen], own=True)
        best: tuple[FloatArray, FloatArray, FloatArray] | None = None
        for other, directions in self.others:
            target = self.skin.patches[touch.target] if touch.target else self.skin.outer
            distance, index = cKDTree(other[target]).query(vertices[patch])
            if best is None or distance.mean() < best[0].mean():
                best = distance, other[target[index]], directions[target[index]]
        assert best is not None, "a touch on people needs a neighbour"
        return _Pairs.of(self.row[patch], best[1], best[2], own=False)

    def measure(self, x: FloatArray) -> Settled:
        """What the parameters make, measured on all outer vertices."""
        rotations, transl = self._parameters(torch.as_tensor(x))
        vertices = self._whole(x)
        outer = vertices[self.skin.outer]
        depth = float((-signed_distance(outer, self.blocks, self.ground)).max())
        for other, _ in self.others:
            depth = max(depth, depth_inside(outer, other, self.skin.faces))
        normals = vertex_normals(vertices, self.skin.faces)
        first, second = _own_pairs(self.skin, vertices, self.skin.outer)
        behind = -((vertices[first] - vertices[second]) * normals[second]).sum(1)
        crossing = float(np.maximum(behind, 0).max(initial=0.0))
        thin = torch.as_tensor(vertices[self.ids])
        distances = self.solid.distances(thin)
        gaps = [float(self._nearest(k, touch, thin, distances).mean()) for k, touch in enumerate(self.plan.touches)]
        return Settled(
            pose=roma.rotmat_to_rotvec(rotations).numpy(),
            transl=transl.numpy(),
            depth=max(depth, 0.0),
            gap=max(gaps, default=0.0),
            crossing=crossing,
        )


def depth_inside(points: FloatArray, other: FloatArray, faces: NDArray[np.int64]) -> float:
    """How deep the deepest of points (n, 3) lies inside a closed mesh (V, 3), (F, 3): metres, 0 where none does.

    Inside is what sees a face from behind in most of three directions; the depth is the distance to the nearest
    vertex's plane.
    """
    from physic_core.testing.casting import Caster

    distance, index = cKDTree(other).query(points, distance_upper_bound=0.15)
    near = np.flatnonzero(np.isfinite(distance))
    if not len(near):
        return 0.0
    caster = Caster(other, faces)
    corners = other[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    votes = np.zeros(len(near), int)
    for direction in np.array([[0.31, 0.90, 0.30], [-0.80, 0.21, 0.56], [0.53, -0.42, -0.74]]):
        face = caster.first(points[near], np.tile(direction, (len(near), 1))).face
        votes += (face >= 0) & (normals[np.maximum(face, 0)] @ direction > 0)
    inside = near[votes >= 2]
    if not len(inside):
        return 0.0
    planes = vertex_normals(other, faces)[index[inside]]
    depth = np.abs(((points[inside] - other[index[inside]]) * planes).sum(1))
    return float(np.minimum(depth, distance[inside]).max())


def _own_pairs(skin: Skin, vertices: FloatArray, ids: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices of a part and the nearest vertices of parts that they may not cross: two lists of ids."""
    firsts, seconds = [], []
    part, folding = skin.part[ids], folding_parts(skin.part_names)
    trees = {p: (ids[part == p], cKDTree(vertices[ids[part == p]])) for p in np.unique(part)}
    for p, (own, _) in trees.items():
        for q, (theirs, tree) in trees.items():
            if folding[p, q]:
                continue
            distance, index = tree.query(vertices[own], distance_upper_bound=_RANGE)
            near = np.isfinite(distance)
            first, second = own[near], theirs[index[near]]
            kept = ~crossing_allowed(skin, first, second)
            firsts.append(first[kept])
            seconds.append(second[kept])
    if not firsts:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.concatenate(firsts), np.concatenate(seconds)


def _sigmas(plan: Plan) -> FloatArray:
    rows = [(plan.drift, 0.5, plan.drift), (0.10, 0.10, 0.10)]
    for name in JOINT_NAMES[1:_FREE]:
        kind = name.split("_")[-1].rstrip("123")
        rows.append(_LOOSE[kind])
    return np.array(rows).reshape(-1)


def _bowl(squared: Tensor) -> Tensor:
    """Square near zero, straight farther out, so that a far patch does not outweigh all else."""
    return torch.where(squared < 25, squared, 10 * squared.clamp(min=1.0).sqrt() - 25)


def _imbalance(joints: Tensor) -> Tensor:
    """Metres of the centre of mass, seen from above, off the line between the middles of the feet."""

    def at(name: str) -> Tensor:
        return joints[JOINT_INDEX[name]]

    weights = sum(weight for *_, weight in _MASSES)
    mass = sum((w * (at(a) + s * (at(b) - at(a))) for a, b, s, w in _MASSES), torch.zeros(3, dtype=joints.dtype))
    mass = (mass / weights)[[0, 2]]
    left, right = (
        (at(f"{side}_ankle") + 0.4 * (at(f"{side}_foot") - at(f"{side}_ankle")))[[0, 2]] for side in ("left", "right")
    )
    line = right - left
    share = ((mass - left) @ line / line.square().sum().clamp(min=1e-6)).clamp(0.1, 0.9)
    return (mass - left - share * line).square().sum().clamp(min=1e-12).sqrt()
