"""Fit of a body pose to contact targets without penetration, by L-BFGS.

The fit optimises translation, orientation and the joints of trunk and limbs, on a subset of the skin vertices. It runs
in rounds: after each round all skin vertices are tested, and those inside a surface are added. The energy has kinks and
the fit stops before convergence, so that a difference in one bit could grow to a centimetre. It therefore uses only
``physic_testing.worlds.reproducible_math``. Room frame (y up), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES
from physic_testing.worlds.lbfgs import minimize
from physic_testing.worlds.reproducible_math import (
    arctan2,
    dot,
    matmul,
    rotation_gradient,
    rotation_matrix,
    round_to_grid,
)
from physic_testing.worlds.skin_patches import (
    ContactSkin,
    contact_skin,
    crossing_allowed,
    folding_parts,
    vertex_normals,
)
from physic_testing.worlds.skinning import Skinner
from physic_testing.worlds.solids import LEVEL_GROUND, Block, Ground, SolidDistances, signed_distance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = [
    "ContactFit",
    "ContactTarget",
    "OtherPerson",
    "PosePlan",
    "PositionTarget",
    "centre_of_mass_of_joints",
    "fit_contacts",
    "largest_penetration",
    "pose_body",
]

_FREE_JOINTS = 22  # pelvis and the 21 joints of trunk and limbs; fingers, jaw and eyes stay as planned
_PENETRATION_SLACK = 0.001  # metres inside that count as touching
_PAIR_RANGE = 0.06  # metres within which two patches of skin are looked at
_ROUNDS = ((0.012, 0.006, 40), (0.005, 0.003, 40), (0.003, 0.0015, 60), (0.003, 0.0012, 40), (0.003, 0.0010, 40))
"""Scale of a gap, scale of a penetration depth, m, and L-BFGS steps of each round."""

_GOOD_DEPTH, _GOOD_GAP = 0.003, 0.012

# Radians by which a joint may leave its plan, about the body's x, y and z.
_JOINT_SIGMAS: dict[str, tuple[float, float, float]] = {
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
class ContactTarget:
    """A skin patch and the surface that the patch should touch.

    Attributes:
        patch: key of ``ContactSkin.patches``.
        share: share of the patch's vertices, the nearest ones, that are to touch.
        on: "scene", "people" or "self".
        blocks: indices of the plan's blocks; empty for the ground, None for the nearest surface.
        target: for "people" and "self", the patch that is touched; empty for all skin.
    """

    patch: str
    share: float
    on: str = "scene"
    blocks: tuple[int, ...] | None = None
    target: str = ""


@dataclass(frozen=True)
class PositionTarget:
    """A skin patch whose centroid is to be near a point, with standard deviation ``sigma`` in metres."""

    patch: str
    point: tuple[float, float, float]
    sigma: float = 0.05

    def __post_init__(self) -> None:
        """Round the point to a grid."""
        x, y, z = round_to_grid(np.array(self.point)).tolist()
        object.__setattr__(self, "point", (x, y, z))


@dataclass(frozen=True)
class PosePlan:
    """Initial pose of one person, with contact targets.

    Attributes:
        action: name of the action.
        pose: (55, 3) rotation vectors, radians.
        betas: (K,) shape.
        pelvis: (3,) position of the pelvis joint, m.
        blocks: furniture of the action.
        touches: contact targets.
        reaches: position targets.
        balanced: whether the centre of mass is to be above the feet.
        drift: standard deviation of the horizontal pelvis position, m.
        azimuth: range of camera directions, degrees; None for the default range of the action.
    """

    action: str
    pose: FloatArray
    betas: FloatArray
    pelvis: tuple[float, float, float]
    blocks: tuple[Block, ...] = ()
    touches: tuple[ContactTarget, ...] = ()
    reaches: tuple[PositionTarget, ...] = ()
    balanced: bool = False
    drift: float = 0.10
    azimuth: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Round pose and position to a grid."""
        x, y, z = round_to_grid(np.array(self.pelvis)).tolist()
        object.__setattr__(self, "pose", round_to_grid(self.pose))
        object.__setattr__(self, "pelvis", (x, y, z))


@dataclass(frozen=True)
class OtherPerson:
    """A person with a fixed pose near the person whose pose is fitted.

    Attributes:
        vertices: (V, 3) vertices of the same mesh.
    """

    vertices: FloatArray


@dataclass(frozen=True)
class ContactFit:
    """Fitted pose of one person, with its errors.

    Attributes:
        pose: (55, 3) rotation vectors, radians.
        transl: (3,) translation, m.
        depth: largest penetration of an outer vertex into the scene or another person, m.
        gap: largest mean distance of a contact target, m.
        crossing: largest penetration of a limb into another part of the own body, m.
    """

    pose: FloatArray
    transl: FloatArray
    depth: float
    gap: float
    crossing: float

    @property
    def residual(self) -> float:
        """Larger one of penetration depth and gap, m."""
        return max(self.depth, self.gap)


def pose_body(
    model: BodyModel, pose: FloatArray, betas: FloatArray, transl: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pose a body: return vertices (V, 3) and joints (55, 3) for pose (55, 3), betas (K,) and transl (3,)."""
    return Skinner(model, betas)(rotation_matrix(np.asarray(pose, np.float64)), np.asarray(transl, np.float64))


def centre_of_mass_of_joints(joints: FloatArray) -> FloatArray:
    """Return the centre of mass (3,) of a body with joints (55, 3), m."""
    centre: FloatArray = (_MASS[:, None] * joints).sum(axis=0)
    return centre


def fit_contacts(
    model: BodyModel,
    plan: PosePlan,
    *,
    around: Sequence[Block] = (),
    ground: Ground = LEVEL_GROUND,
    neighbours: Sequence[OtherPerson] = (),
) -> ContactFit:
    """Fit the pose of one person to its contact targets; soft blocks have given way completely.

    Args:
        model: body model in float64.
        plan: initial pose and targets.
        around: blocks beside those of the plan.
        ground: ground plane.
        neighbours: other people, who do not move.
    """
    near = [block for block in around if _within_reach(plan, block)]
    blocks = tuple(block.pressed() for block in (*plan.blocks, *near))
    fit = _ContactEnergy(model, plan, blocks, ground, neighbours)
    x: FloatArray = np.zeros(fit.size)
    for number, (gap, depth, steps) in enumerate(_ROUNDS):
        fit.look_around(x, gap, depth)
        x = minimize(fit, x, steps)
        settled = fit.measure(x)
        if number >= 2 and settled.depth < _GOOD_DEPTH and settled.gap < _GOOD_GAP and settled.crossing < 0.008:
            break
    return settled


def _within_reach(plan: PosePlan, block: Block) -> bool:
    """Return whether a person can reach a block."""
    away = np.linalg.norm(np.array(block.centre) - np.array(plan.pelvis))
    return bool(away < 1.5 + np.linalg.norm(block.half))


@dataclass(frozen=True)
class _Pairs:
    """Vertices paired with the tangent plane of their nearest surface point, which is fixed or on the own body."""

    rows: NDArray[Any]
    points: NDArray[Any]  # fixed points, or rows of the own body
    normals: FloatArray
    own: bool

    def apart(self, vertices: FloatArray) -> FloatArray:
        """Return the vectors (n, 3) from the surface points to the vertices."""
        away: FloatArray = vertices[self.rows] - (vertices[self.points] if self.own else self.points)
        return away

    def signed(self, vertices: FloatArray) -> FloatArray:
        """Return the signed distances (n,) to the tangent planes."""
        return dot(self.apart(vertices), self.normals)

    def distance(self, vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distances (n,) to the tangent planes and gradients (n, 3); small sideways offsets do not count."""
        apart = self.apart(vertices)
        signed = dot(apart, self.normals)
        aside = np.sqrt(np.maximum(dot(apart, apart) - signed * signed, 1e-12))
        beyond = np.maximum(aside - 0.02, 0)
        distance = np.sqrt(np.maximum(signed * signed + beyond * beyond, 1e-14))
        sideways = (apart - signed[:, None] * self.normals) * (beyond / aside)[:, None]
        return distance, (signed[:, None] * self.normals + sideways) / distance[:, None]

    def pull(self, by_vertices: FloatArray, chosen: NDArray[Any], by_apart: FloatArray) -> None:
        """Add the gradient (m, 3) with respect to some pairs' vectors to the vertex gradient."""
        np.add.at(by_vertices, self.rows[chosen], by_apart)
        if self.own:
            np.subtract.at(by_vertices, self.points[chosen], by_apart)


class _ContactEnergy:
    """Energy of a pose plan over normalised parameters, with nearest-point pairs that are updated between rounds."""

    def __init__(
        self,
        model: BodyModel,
        plan: PosePlan,
        blocks: tuple[Block, ...],
        ground: Ground,
        neighbours: Sequence[OtherPerson],
    ) -> None:
        self.model, self.plan, self.blocks, self.ground = model, plan, blocks, ground
        self.skin: ContactSkin = contact_skin(model)
        self.solid = SolidDistances(blocks, ground)
        self.columns = [self._columns(touch) for touch in plan.touches]
        self.start = rotation_matrix(plan.pose)
        self.whole = Skinner(model, plan.betas)
        _, joints = self.whole(self.start, np.zeros(3))
        self.transl = np.array(plan.pelvis) - joints[0]
        self.sigma = _parameter_sigmas(plan)
        self.size = len(self.sigma)
        self.others = [(n.vertices, vertex_normals(n.vertices, self.skin.faces)) for n in neighbours]
        wanted = [self.skin.patches[t.patch] for t in plan.touches] + [self.skin.patches[r.patch] for r in plan.reaches]
        wanted += [self.skin.patches[t.target] for t in plan.touches if t.on == "self"]
        self.ids = np.unique(np.concatenate([self.skin.thinned, *wanted]))
        self.gap = self.depth = 0.01
        self._gather()

    def _columns(self, touch: ContactTarget) -> NDArray[np.int64]:
        """Return the indices of the surfaces of a contact target."""
        if touch.blocks is None:
            return np.arange(len(self.blocks) + 1)
        return np.array(list(touch.blocks) or [len(self.blocks)])

    def _gather(self) -> None:
        """Restrict posing to the vertices that the energy uses."""
        self.posed = Skinner(self.model, self.plan.betas, self.ids)
        self.row = np.full(self.model.num_vertices, -1)
        self.row[self.ids] = np.arange(len(self.ids))
        self.touch_rows = [self.row[self.skin.patches[t.patch]] for t in self.plan.touches]
        self.reach_rows = [self.row[self.skin.patches[r.patch]] for r in self.plan.reaches]

    def _parameters(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations and translation of normalised parameters."""
        moved = x * self.sigma
        turn = rotation_matrix(moved[3:].reshape(_FREE_JOINTS, 3))
        rotations = self.start.copy()
        rotations[0] = matmul(turn[0], self.start[0])
        rotations[1:_FREE_JOINTS] = matmul(self.start[1:_FREE_JOINTS], turn[1:])
        return rotations, self.transl + moved[:3]

    def __call__(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the energy of normalised parameters (n,) and its gradient (n,)."""
        rotations, transl = self._parameters(x)
        vertices, joints = self.posed(rotations, transl)
        limits, by_limits = _joint_limits(rotations)
        imbalance, by_joints = self._balance(joints)
        by_vertices = np.zeros_like(vertices)
        distances = self.solid.distances(vertices)
        total = float((x * x).sum()) + limits + imbalance
        total += self._penetration_energy(vertices, distances, by_vertices)
        total += self._target_energy(vertices, distances, by_vertices)
        by_rotations, by_transl = self.posed.gradient(by_vertices, by_joints)
        by_rotations += by_limits
        by_turn = matmul(np.swapaxes(self.start[:_FREE_JOINTS], 1, 2), by_rotations[:_FREE_JOINTS])
        by_turn[0] = matmul(by_rotations[0], self.start[0].T)
        by_moved = rotation_gradient((x * self.sigma)[3:].reshape(_FREE_JOINTS, 3), by_turn)
        return total, 2 * x + np.concatenate([by_transl, by_moved.reshape(-1)]) * self.sigma

    def _penetration_energy(self, vertices: FloatArray, distances: FloatArray, by_vertices: FloatArray) -> float:
        """Return the penetration energy (scene, own body, other people); add its vertex gradient."""
        nearest = distances.argmin(axis=0)
        inside = -distances[nearest, np.arange(len(vertices))] - _PENETRATION_SLACK
        deep = np.flatnonzero(inside > 0)
        amount = inside[deep] / self.depth
        by_vertices[deep] -= (2 * amount / self.depth)[:, None] * self.solid.normals(vertices[deep], nearest[deep])
        total = float((amount * amount).sum())
        for pairs, slack in ((self.near_self, 0.002), (self.near_people, _PENETRATION_SLACK)):
            if pairs is not None:
                inside = -pairs.signed(vertices) - slack
                deep = np.flatnonzero(inside > 0)
                amount = inside[deep] / self.depth
                pairs.pull(by_vertices, deep, -(2 * amount / self.depth)[:, None] * pairs.normals[deep])
                total += float((amount * amount).sum())
        return total

    def _target_energy(self, vertices: FloatArray, distances: FloatArray, by_vertices: FloatArray) -> float:
        """Return the energy of missed contact and position targets; add its vertex gradient."""
        total = 0.0
        for k, touch in enumerate(self.plan.touches):
            near, chosen, normals = self._nearest(k, touch, vertices, distances)
            squared = (near / self.gap) * (near / self.gap)
            bowl, slope = _robust_loss(squared)
            total += 4 * float(bowl.sum()) / len(near)
            by_near = (8 / len(near) * slope * near / self.gap / self.gap)[:, None] * normals
            if touch.on == "scene":
                np.add.at(by_vertices, self.touch_rows[k][chosen], by_near)
            else:
                self.touch_pairs[k].pull(by_vertices, chosen, by_near)
        for reach, rows in zip(self.plan.reaches, self.reach_rows, strict=True):
            away = (vertices[rows].sum(axis=0) / len(rows) - np.array(reach.point)) / reach.sigma
            total += float(dot(away, away))
            by_vertices[rows] += 2 * away / reach.sigma / len(rows)
        return total

    def _nearest(
        self, k: int, touch: ContactTarget, vertices: FloatArray, distances: FloatArray
    ) -> tuple[FloatArray, NDArray[Any], FloatArray]:
        """Return distances (m,), indices and gradients (m, 3) of a patch's vertices nearest to their target."""
        rows, columns = self.touch_rows[k], self.columns[k]
        if touch.on == "scene":
            among = distances[columns][:, rows]
            which = among.argmin(axis=0)
            signed = among[which, np.arange(len(rows))]
            distance = np.abs(signed)
        else:
            distance, normals = self.touch_pairs[k].distance(vertices)
        count = min(max(3, round(touch.share * len(distance))), len(distance))
        chosen = np.argsort(distance, kind="stable")[:count]
        if touch.on == "scene":
            outwards = self.solid.normals(vertices[rows[chosen]], columns[which[chosen]])
            return distance[chosen], chosen, np.where(signed[chosen, None] < 0, -outwards, outwards)
        return distance[chosen], chosen, normals[chosen]

    def _balance(self, joints: FloatArray) -> tuple[float, FloatArray]:
        """Return the balance energy and its joint gradient (55, 3)."""
        gradient = np.zeros_like(joints)
        if not self.plan.balanced:
            return 0.0, gradient
        mass, left, right = (_horizontal_position(weights, joints) for weights in (_MASS, *_FEET))
        line = right - left
        square = max(float(line[0] * line[0] + line[1] * line[1]), 1e-6)
        share = min(max(float((mass - left)[0] * line[0] + (mass - left)[1] * line[1]) / square, 0.1), 0.9)
        off = mass - left - share * line
        length = float(np.sqrt(max(float(off[0] * off[0] + off[1] * off[1]), 1e-12)))
        amount = max(length - 0.02, 0.0) / 0.015
        # Along the line the foot of the perpendicular follows, so that only what is across it counts.
        weights = _MASS - (1 - share) * _FEET[0] - share * _FEET[1]
        gradient[:, [0, 2]] = (2 * amount / 0.015 / length) * weights[:, None] * off
        return amount * amount, gradient

    def look_around(self, x: FloatArray, gap: float, depth: float) -> None:
        """Set the scales of the energy, add penetrating vertices and update the nearest-point pairs."""
        self.gap, self.depth = gap, depth
        vertices = self._whole(x)
        outer = vertices[self.skin.outer]
        inside = signed_distance(outer, self.blocks, self.ground) < -_PENETRATION_SLACK
        for other, directions in self.others:
            distance, index = cKDTree(other).query(outer, distance_upper_bound=_PAIR_RANGE)
            near = np.flatnonzero(np.isfinite(distance))
            chosen = index[near]
            inside[near] |= ((outer[near] - other[chosen]) * directions[chosen]).sum(1) < -_PENETRATION_SLACK
        self.ids = np.union1d(self.ids, self.skin.outer[inside])
        self._gather()
        normals = vertex_normals(vertices, self.skin.faces)
        self.near_self = self._self_pairs(vertices, normals, self.ids)
        self.near_people = self._people_pairs(vertices)
        self.touch_pairs = [self._touch_pairs(touch, vertices, normals) for touch in self.plan.touches]

    def _whole(self, x: FloatArray) -> FloatArray:
        """Return all posed vertices."""
        return self.whole(*self._parameters(x))[0]

    def _self_pairs(self, vertices: FloatArray, normals: FloatArray, ids: NDArray[Any]) -> _Pairs | None:
        """Pair vertices with nearby skin of other body parts."""
        first, second = _self_contact_pairs(self.skin, vertices, ids)
        if not len(first):
            return None
        return _Pairs(self.row[first], self.row[second], normals[second], own=True)

    def _people_pairs(self, vertices: FloatArray) -> _Pairs | None:
        """Pair vertices with nearby skin of other people."""
        rows, points, normals = [], [], []
        for other, directions in self.others:
            distance, index = cKDTree(other[self.skin.outer]).query(
                vertices[self.ids], distance_upper_bound=_PAIR_RANGE
            )
            near = np.flatnonzero(np.isfinite(distance))
            chosen = self.skin.outer[index[near]]
            rows.append(near)
            points.append(other[chosen])
            normals.append(directions[chosen])
        if not rows or not sum(len(r) for r in rows):
            return None
        return _Pairs(np.concatenate(rows), np.concatenate(points), np.concatenate(normals), own=False)

    def _touch_pairs(self, touch: ContactTarget, vertices: FloatArray, normals: FloatArray) -> Any:
        """Pair the vertices of a contact target with its skin target; None for the scene."""
        if touch.on == "scene":
            return None
        patch = self.skin.patches[touch.patch]
        if touch.on == "self":
            target = self.skin.patches[touch.target]
            _, index = cKDTree(vertices[target]).query(vertices[patch])
            chosen = target[index]
            return _Pairs(self.row[patch], self.row[chosen], normals[chosen], own=True)
        best: tuple[FloatArray, FloatArray, FloatArray] | None = None
        for other, directions in self.others:
            target = self.skin.patches[touch.target] if touch.target else self.skin.outer
            distance, index = cKDTree(other[target]).query(vertices[patch])
            if best is None or distance.sum() < best[0].sum():
                best = distance, other[target[index]], directions[target[index]]
        assert best is not None, "a touch on people needs a neighbour"
        return _Pairs(self.row[patch], best[1], best[2], own=False)

    def measure(self, x: FloatArray) -> ContactFit:
        """Return the fitted pose with its errors over all outer vertices."""
        rotations, transl = self._parameters(x)
        pose, transl = round_to_grid(Rotation.from_matrix(rotations).as_rotvec()), round_to_grid(transl)
        vertices, _ = self.whole(rotation_matrix(pose), transl)
        outer = vertices[self.skin.outer]
        depth = float((-signed_distance(outer, self.blocks, self.ground)).max())
        for other, _ in self.others:
            depth = max(depth, largest_penetration(outer, other, self.skin.faces))
        normals = vertex_normals(vertices, self.skin.faces)
        first, second = _self_contact_pairs(self.skin, vertices, self.skin.outer)
        crossing = float(np.maximum(-dot(vertices[first] - vertices[second], normals[second]), 0).max(initial=0.0))
        thin = vertices[self.ids]
        distances = self.solid.distances(thin)
        gaps = [float(self._nearest(k, touch, thin, distances)[0].mean()) for k, touch in enumerate(self.plan.touches)]
        return ContactFit(
            pose=pose,
            transl=transl,
            depth=max(depth, 0.0),
            gap=max(gaps, default=0.0),
            crossing=crossing,
        )


def largest_penetration(points: FloatArray, other: FloatArray, faces: NDArray[np.int64]) -> float:
    """Return the largest penetration of points (n, 3) into a closed mesh (V, 3), (F, 3), in metres; 0 if there is none.

    Inside is what sees a face from behind in most of three directions; the depth is the distance to the nearest
    vertex's plane.
    """
    from physic_core.geometry.rays import RayCaster

    distance, index = cKDTree(other).query(points, distance_upper_bound=0.15)
    near = np.flatnonzero(np.isfinite(distance))
    if not len(near):
        return 0.0
    caster = RayCaster(other, faces)
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


def _self_contact_pairs(
    skin: ContactSkin, vertices: FloatArray, ids: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return ids of vertices and of the nearest vertices of body parts that they must not penetrate."""
    firsts, seconds = [], []
    part, folding = skin.part[ids], folding_parts(skin.part_names)
    trees = {p: (ids[part == p], cKDTree(vertices[ids[part == p]])) for p in np.unique(part)}
    for p, (own, _) in trees.items():
        for q, (theirs, tree) in trees.items():
            if folding[p, q]:
                continue
            distance, index = tree.query(vertices[own], distance_upper_bound=_PAIR_RANGE)
            near = np.isfinite(distance)
            first, second = own[near], theirs[index[near]]
            kept = ~crossing_allowed(skin, first, second)
            firsts.append(first[kept])
            seconds.append(second[kept])
    if not firsts:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.concatenate(firsts), np.concatenate(seconds)


def _parameter_sigmas(plan: PosePlan) -> FloatArray:
    """Return the standard deviations of all fit parameters."""
    rows = [(plan.drift, 0.5, plan.drift), (0.10, 0.10, 0.10)]
    for name in JOINT_NAMES[1:_FREE_JOINTS]:
        kind = name.split("_")[-1].rstrip("123")
        rows.append(_JOINT_SIGMAS[kind])
    return np.array(rows).reshape(-1)


def _robust_loss(squared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a Huber-like loss of squared residuals and its derivative."""
    root = np.sqrt(np.maximum(squared, 1.0))
    near = squared < 25
    return np.where(near, squared, 10 * root - 25), np.where(near, 1.0, 5 / root)


_KNEES, _ELBOWS = ([JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right")] for name in ("knee", "elbow"))
# Of each hinge: the joint, the entries of its matrix that are sine and cosine of its flexion, and the sine's sign.
_HINGES = tuple(
    (joint, sine, cosine, sign)
    for joints, sine, cosine, signs in ((_KNEES, (2, 1), (1, 1), (1, 1)), (_ELBOWS, (2, 0), (0, 0), (1, -1)))
    for joint, sign in zip(joints, signs, strict=True)
)
_MOST_FLEXION, _LIMIT_SIGMA = 2.7, 0.05  # radians


def _joint_limits(rotations: FloatArray) -> tuple[float, FloatArray]:
    """Return the joint-limit energy of knees and elbows and its gradient (55, 3, 3)."""
    total, gradient = 0.0, np.zeros_like(rotations)
    for joint, sine, cosine, sign in _HINGES:
        y, x = sign * float(rotations[joint][sine]), float(rotations[joint][cosine])
        angle = float(arctan2(y, x))
        beyond = max(-angle, 0.0) + max(angle - _MOST_FLEXION, 0.0)
        total += (beyond / _LIMIT_SIGMA) * (beyond / _LIMIT_SIGMA)
        slope = (-2 if angle < 0 else 2) * beyond / _LIMIT_SIGMA / _LIMIT_SIGMA / (x * x + y * y)
        gradient[joint][sine] += slope * sign * x
        gradient[joint][cosine] -= slope * y
    return total, gradient


def _weights_between_joints(shares: Sequence[tuple[str, str, float, float]]) -> FloatArray:
    """Return joint weights (55,) of a weighted sum of points between joint pairs."""
    weights = np.zeros(len(JOINT_NAMES))
    for first, second, share, weight in shares:
        weights[JOINT_INDEX[first]] += weight * (1 - share)
        weights[JOINT_INDEX[second]] += weight * share
    return weights


_MASS = _weights_between_joints(_MASSES) / sum(weight for *_, weight in _MASSES)
_FEET = tuple(_weights_between_joints([(f"{side}_ankle", f"{side}_foot", 0.4, 1.0)]) for side in ("left", "right"))


def _horizontal_position(weights: FloatArray, joints: FloatArray) -> FloatArray:
    """Return x and z (2,) of a weighted sum of joints (55, 3)."""
    place: FloatArray = (weights[:, None] * joints[:, [0, 2]]).sum(axis=0)
    return place
