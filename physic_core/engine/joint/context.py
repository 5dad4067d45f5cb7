"""What stays as it is for a whole run of the joint optimisation: tracked vertices, keypoints, the scene's surface."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel, BodyOutput, LandmarkModel
from physic_core.engine.joint.conventions import Conventions
from physic_core.engine.joint.distances import plane_height, root_relative
from physic_core.engine.joint.limbs import observed_parts, stands
from physic_core.engine.joint.problem import JointProblem
from physic_core.geometry.camera import project
from physic_core.geometry.coarse_mesh import clusters
from physic_core.geometry.free_space import fronts
from physic_core.geometry.visibility import inside_image, vertex_areas

__all__ = ["STATIC_CONTACTS", "JointContext", "Keypoints", "precompute", "representatives", "seen_joints"]

STATIC_CONTACTS = ("left_foot", "right_foot", "left_hand", "right_hand", "thighs", "gluteus", "back")
"""What usually touches the world, after PROX."""

_LEGS = [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("knee", "ankle")]
_ANKLES = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
_GRID = float(1 << 20)  # steps a metre
_AREA_UNIT_M2 = 0.01  # a square decimetre, half a sole: the surface that counts once
_CONTACT_PROBABILITY = 0.5  # of a contact vertex; what a classifier's probability is calibrated to
_FLOOR_BAND_M = 0.05  # scene points this near to the floor's plane are the floor, and left to the plane


@dataclass(frozen=True)
class Keypoints:
    """Detected keypoints with their weights.

    Attributes:
        points: (B, J, 2) px, finite.
        weight: (B, J) 0 for what does not count.
        confident: (B, J) bool, confident keypoints on limbs that the photo shows.
    """

    points: Tensor
    weight: Tensor
    confident: Tensor


@dataclass(frozen=True)
class JointContext:
    """Everything that stays constant during the joint optimisation. B people, n tracked vertices.

    Attributes:
        problem: with finite people only.
        conventions: of the energy.
        ids: (n,) int64 of the tracked vertices.
        faces_around: their rows of the body's.
        pose: poses keypoints, joints and tracked vertices alone.
        area: (B, n) surface that each tracked vertex stands for, square decimetres; ones where vertices are counted.
        contact_probability: (B, n) finite.
        is_contact: (B, n) bool, contact vertices: of a probability of at least one half.
        seen_part: (B, n) bool, on a limb that the photo shows.
        over_knees: (n,) bool, on neither a lower leg nor a foot.
        soles: rows of ``ids`` of the left and of the right sole; empty where the body has none.
        keypoints: with their weights.
        person_px: (B,) stature in px at the person's depth.
        start: posed bodies at the start, all vertices.
        relative: (B, n, 3) tracked vertices at the start in the root's frame, metres.
        stands: (B,) bool, see :func:`physic_core.engine.joint.limbs.stands`.
        legs_unseen: (B,) bool, neither knees nor ankles are shown.
        feet_seen: (B, 2) bool.
        log_depth: (H, W) logarithm of the original photo's depth, NaN where unknown; or None.
        fronts: of the scene, see :mod:`physic_core.geometry.free_space`; None where free space is not used.
        surface: scene points that count as surface, (M, 3) metres.
        surface_normals: (M, 3).
    """

    problem: JointProblem
    conventions: Conventions
    ids: Tensor
    faces_around: Tensor
    pose: LandmarkModel
    area: Tensor
    contact_probability: Tensor
    is_contact: Tensor
    seen_part: Tensor
    over_knees: Tensor
    soles: tuple[Tensor, Tensor]
    keypoints: Keypoints
    person_px: Tensor
    start: BodyOutput
    relative: Tensor
    stands: Tensor
    legs_unseen: Tensor
    feet_seen: Tensor
    log_depth: Tensor | None
    fronts: Tensor | None
    surface: Tensor
    surface_normals: Tensor

    @property
    def floor_normal(self) -> Tensor | None:
        """(3,) unit normal of the plane that distances to the floor are measured from; None where there is none."""
        return self.problem.floor_normal if self.conventions.floor == "plane" else None


@torch.no_grad()
def precompute(problem: JointProblem, conventions: Conventions) -> JointContext:
    """Compute what stays constant.

    Args:
        problem: with finite people only.
        conventions: of the energy.
    """
    model = problem.model
    start = model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0)
    observed = seen_joints(problem, conventions)
    height, width = problem.masks.shape[-2:]
    probability = _contact_probability(problem, conventions)
    is_contact = probability >= _CONTACT_PROBABILITY
    area = vertex_areas(start.vertices, model.faces)
    ids, area = representatives(model, is_contact.any(0), conventions.vertex_spacing_m, area)
    person_px = problem.K[1, 1] * model.stature(problem.betas0) / start.joints[:, 0, 2].clamp(min=0.1)
    use_fronts = conventions.free_space and problem.scene_depth is not None
    surface, surface_normals = _surface(problem, conventions)
    return JointContext(
        problem=problem,
        conventions=conventions,
        ids=ids,
        faces_around=model.faces_around[ids],
        pose=model.landmarks_only([problem.skeleton], ids),
        area=torch.ones_like(area) if conventions.count_vertices else area / _AREA_UNIT_M2,
        contact_probability=probability[:, ids],
        is_contact=is_contact[:, ids],
        seen_part=observed_parts(model.part_names, observed)[:, model.part_of_vertex[ids]],
        over_knees=_over_knees(model)[ids],
        soles=_sole_rows(model, ids),
        keypoints=conventions.weigh_keypoints(problem, person_px, observed),
        person_px=person_px,
        start=start,
        relative=root_relative(start.vertices[:, ids], start.joints[:, 0], problem.rotations0[:, 0]),
        stands=stands(problem.rotations0, start.joints, observed, problem.floor_normal),
        legs_unseen=~observed[:, _LEGS].any(1),
        feet_seen=observed[:, _ANKLES] & inside_image(project(start.joints[:, _ANKLES], problem.K), height, width),
        log_depth=_log_depth(problem.human_depth),
        fronts=fronts(problem.scene_depth) if use_fronts and problem.scene_depth is not None else None,
        surface=surface,
        surface_normals=surface_normals,
    )


def _contact_probability(problem: JointProblem, conventions: Conventions) -> Tensor:
    """(B, V)."""
    probability = torch.nan_to_num(problem.contact_probability)
    if conventions.static_contacts:
        probability = torch.zeros_like(probability)
        for name in STATIC_CONTACTS:
            probability[:, problem.model.contact_sets[name]] = 1.0
    return probability


def representatives(model: BodyModel, keep: Tensor, spacing: float, area: Tensor) -> tuple[Tensor, Tensor]:
    """Thin a mesh: one vertex for each cell of space and part in the T-pose, standing for the surface of all.

    Args:
        model: body model.
        keep: (V,) bool, vertices that stand for themselves.
        spacing: side of a cell, metres; 0 keeps all outer vertices.
        area: (B, V) of all vertices.

    Returns:
        ids: (n,) int64, ascending; soles and ``keep`` are always among them, cavities never.
        area: (B, n).
    """
    keep = keep.clone()
    for name in ("left_sole", "right_sole"):
        if name in model.contact_sets:
            keep[model.contact_sets[name]] = True
    keep &= model.outer
    if spacing <= 0:
        ids = model.outer.nonzero(as_tuple=True)[0]
        return ids, area[:, ids]
    rest = (model.outer & ~keep).nonzero(as_tuple=True)[0]
    # Vertices of the midline lie on the side of a cell: rounded, they fall into the same one on every CPU.
    exact = model.to(dtype=torch.float64)
    at = torch.round(exact(*exact.zero_pose(1)).vertices[0, rest] * _GRID) / _GRID
    group, chosen = clusters(at, model.part_of_vertex[rest], spacing)
    summed = area.new_zeros(len(area), len(chosen)).index_add(1, group, area[:, rest])
    kept = keep.nonzero(as_tuple=True)[0]
    ids = torch.cat([kept, rest[chosen]])
    order = ids.argsort()
    return ids[order], torch.cat([area[:, kept], summed], 1)[:, order]


def _over_knees(model: BodyModel) -> Tensor:
    """(V,) bool."""
    high = [not name.endswith(("lower_leg", "foot")) for name in model.part_names]
    return torch.tensor(high, device=model.part_of_vertex.device)[model.part_of_vertex]


def _sole_rows(model: BodyModel, ids: Tensor) -> tuple[Tensor, Tensor]:
    row = torch.full((model.num_vertices,), -1, dtype=torch.int64, device=ids.device)
    row[ids] = torch.arange(len(ids), device=ids.device)
    none = ids.new_zeros(0)
    left, right = (row[model.contact_sets.get(f"{side}_sole", none)] for side in ("left", "right"))
    return left[left >= 0], right[right >= 0]


def seen_joints(problem: JointProblem, conventions: Conventions) -> Tensor:
    """(B, 55) bool, joints that the photo shows; all of them where an energy takes all limbs as seen."""
    if conventions.observed_limbs_only:
        return problem.observed.bool()
    return torch.ones_like(problem.observed, dtype=torch.bool)


def _log_depth(depth: Tensor | None) -> Tensor | None:
    if depth is None:
        return None
    return torch.where(depth > 0, depth, torch.full_like(depth, torch.nan)).log()


def _surface(problem: JointProblem, conventions: Conventions) -> tuple[Tensor, Tensor]:
    """Scene points to measure against. Without a reliable normal a point has no inside: it is left out where
    distances are taken along normals; and where the floor is a plane, its points are left to the plane."""
    points, normals = problem.scene_points, problem.scene_normals
    ones = points.new_ones(3)  # a product sums three columns several times faster than a sum does
    length = normals.square() @ ones
    finite = torch.isfinite(points @ ones + length)
    if conventions.along_normals:
        finite = finite & (length > 0.5)
    if problem.floor_normal is not None and conventions.floor == "plane":
        offset = points.new_tensor(problem.floor_offset)
        finite = finite & (plane_height(points, problem.floor_normal, offset).abs() > _FLOOR_BAND_M)
    points, normals = points[finite], normals[finite]
    if problem.floor_normal is not None and problem.floor_points is not None and conventions.floor == "points":
        up = problem.floor_normal.expand_as(problem.floor_points)
        points, normals = torch.cat([points, problem.floor_points]), torch.cat([normals, up])
    return points, normals
