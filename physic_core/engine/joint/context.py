"""Constants of the joint optimisation: subsampled vertices, keypoints and the scene's surface."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.body.model import BodyModel, BodyOutput, LandmarkModel
from physic_core.engine.distances import plane_height, root_relative
from physic_core.engine.joint.energy_options import EnergyOptions
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.settings import JointSettings
from physic_core.engine.limbs import is_standing, observed_parts
from physic_core.geometry.camera import project
from physic_core.geometry.coarse_mesh import cluster_points
from physic_core.geometry.free_space import front_depth
from physic_core.geometry.mesh import vertex_areas
from physic_core.geometry.visibility import inside_image

__all__ = ["STATIC_CONTACT_PARTS", "JointContext", "Keypoints", "precompute", "subsample_vertices"]

STATIC_CONTACT_PARTS = ("left_foot", "right_foot", "left_hand", "right_hand", "thighs", "gluteus", "back")
"""Parts of the body that usually touch the scene, after PROX."""

_ANKLES = joint_pair("ankle")
_STEPS_PER_M = float(1 << 20)  # to which positions are rounded
_CONTACT_PROBABILITY = 0.5  # at least, of a contact vertex
_FLOOR_BAND_M = 0.05  # scene points nearer to the floor's plane belong to the floor


@dataclass(frozen=True)
class Keypoints:
    """Detected keypoints and their weights.

    Attributes:
        points: (B, J, 2) px, finite.
        weight: (B, J), 0 for keypoints that are left out.
        confident: (B, J) bool, confident keypoints on visible limbs.
    """

    points: Tensor
    weight: Tensor
    confident: Tensor


@dataclass(frozen=True)
class JointContext:
    """Constants of one joint optimisation. B people, n subsampled vertices.

    Attributes:
        problem: as the energy uses it, with finite people only.
        ids: (n,) int64, indices of the subsampled vertices.
        faces_of_vertices: adjacent faces of each subsampled vertex.
        pose: poses keypoints, joints and subsampled vertices only.
        area: (B, n) weight of each subsampled vertex: its surface, square decimetres, in preset "default".
        contact_probability: (B, n) finite.
        is_contact: (B, n) bool, contact vertices: of a probability of at least one half.
        on_visible_part: (B, n) bool, on a visible limb.
        above_knees: (n,) bool, on neither a lower leg nor a foot.
        soles: rows of ``ids`` of the left and of the right sole; empty if the body has none.
        keypoints: with their weights.
        person_px: (B,) stature in px at the person's depth.
        start: posed bodies at the start, all vertices.
        relative: (B, n, 3) subsampled vertices at the start in the root's frame, metres.
        standing: (B,) bool, see :func:`physic_core.engine.limbs.is_standing`; not with both feet in the air.
        feet_visible: (B, 2) bool.
        log_depth: (H, W) logarithm of the depth map of the original photo, NaN where unknown; or None.
        fronts: of the scene, see :mod:`physic_core.geometry.free_space`; None if free space is not used.
        surface: (M, 3) metres, scene points that distances are measured to.
        surface_normals: (M, 3).
    """

    problem: JointProblem
    options: EnergyOptions
    ids: Tensor
    faces_of_vertices: Tensor
    pose: LandmarkModel
    area: Tensor
    contact_probability: Tensor
    is_contact: Tensor
    on_visible_part: Tensor
    above_knees: Tensor
    soles: tuple[Tensor, Tensor]
    keypoints: Keypoints
    person_px: Tensor
    start: BodyOutput
    relative: Tensor
    standing: Tensor
    feet_visible: Tensor
    log_depth: Tensor | None
    fronts: Tensor | None
    surface: Tensor
    surface_normals: Tensor

    @property
    def floor_normal(self) -> Tensor | None:
        """Unit normal (3,) of the floor's plane; None if there is no floor or the energy does not use the plane."""
        return None if self.options.floor_samples else self.problem.floor_normal


@torch.no_grad()
def precompute(problem: JointProblem, settings: JointSettings) -> JointContext:
    """Compute the constants of one joint optimisation of a problem with finite people only."""
    problem, options, model = settings.prepare(problem), settings.energy_options, problem.model
    start = model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0)
    observed = problem.observed.bool()
    height, width = problem.masks.shape[-2:]
    probability = _contact_probability(problem, options)
    is_contact = probability >= _CONTACT_PROBABILITY
    area = vertex_areas(start.vertices, model.faces)
    ids, area = subsample_vertices(model, is_contact.any(0), options.vertex_spacing_m, area)
    person_px = problem.K[1, 1] * model.stature(problem.betas0) / start.joints[:, 0, 2].clamp(min=0.1)
    depth = problem.human_depth
    use_fronts = options.free_space and problem.scene_depth is not None
    surface, surface_normals = _surface(problem, options)
    return JointContext(
        problem=problem,
        options=options,
        ids=ids,
        faces_of_vertices=model.faces_of_vertices[ids],
        pose=model.landmarks_only([problem.skeleton], ids),
        area=settings.weigh_vertices(area),
        contact_probability=probability[:, ids],
        is_contact=is_contact[:, ids],
        on_visible_part=observed_parts(model.part_names, observed)[:, model.part_of_vertex[ids]],
        above_knees=_above_knees(model)[ids],
        soles=_sole_rows(model, ids),
        keypoints=settings.weigh_keypoints(problem, person_px),
        person_px=person_px,
        start=start,
        relative=root_relative(start.vertices[:, ids], start.joints[:, 0], problem.rotations0[:, 0]),
        standing=_standing(problem, start.joints, observed),
        feet_visible=observed[:, _ANKLES] & inside_image(project(start.joints[:, _ANKLES], problem.K), height, width),
        log_depth=None if depth is None else torch.where(depth > 0, depth, torch.nan).log(),
        fronts=front_depth(problem.scene_depth) if use_fronts and problem.scene_depth is not None else None,
        surface=surface,
        surface_normals=surface_normals,
    )


def _standing(problem: JointProblem, joints: Tensor, observed: Tensor) -> Tensor:
    """Return the people (B,) bool who stand by their pose, and have a foot on something."""
    standing = is_standing(problem.rotations0, joints, observed, problem.floor_normal)
    return standing if problem.lifted_feet is None else standing & ~problem.lifted_feet.all(1)


def _contact_probability(problem: JointProblem, options: EnergyOptions) -> Tensor:
    """Return the contact probability of each vertex (B, V), from the prior or 1 on static parts."""
    probability = torch.nan_to_num(problem.contact_probability)
    if options.static_contacts:
        probability = torch.zeros_like(probability)
        for name in STATIC_CONTACT_PARTS:
            probability[:, problem.model.contact_sets[name]] = 1.0
    return torch.where(problem.feet_in_air(), 0.0, probability)


def subsample_vertices(model: BodyModel, keep: Tensor, spacing: float, area: Tensor) -> tuple[Tensor, Tensor]:
    """Subsample vertices: select one per grid cell and body part in the T-pose, with the summed area of its group.

    Args:
        keep: (V,) bool, vertices that are always selected.
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
    # Vertices of the midline lie on the border of two cells. Rounding puts them into the same cell on every CPU.
    exact = model.to(dtype=torch.float64)
    at = torch.round(exact(*exact.zero_pose(1)).vertices[0, rest] * _STEPS_PER_M) / _STEPS_PER_M
    group, chosen = cluster_points(at, model.part_of_vertex[rest], spacing)
    summed = area.new_zeros(len(area), len(chosen)).index_add(1, group, area[:, rest])
    kept = keep.nonzero(as_tuple=True)[0]
    ids = torch.cat([kept, rest[chosen]])
    order = ids.argsort()
    return ids[order], torch.cat([area[:, kept], summed], 1)[:, order]


def _above_knees(model: BodyModel) -> Tensor:
    """Return the vertices (V,) bool on neither a lower leg nor a foot."""
    high = [not name.endswith(("lower_leg", "foot")) for name in model.part_names]
    return torch.tensor(high, device=model.part_of_vertex.device)[model.part_of_vertex]


def _sole_rows(model: BodyModel, ids: Tensor) -> tuple[Tensor, Tensor]:
    """Return the rows of ``ids`` that are on the left and on the right sole."""
    row = torch.full((model.num_vertices,), -1, dtype=torch.int64, device=ids.device)
    row[ids] = torch.arange(len(ids), device=ids.device)
    none = ids.new_zeros(0)
    left, right = (row[model.contact_sets.get(f"{side}_sole", none)] for side in ("left", "right"))
    return left[left >= 0], right[right >= 0]


def _surface(problem: JointProblem, options: EnergyOptions) -> tuple[Tensor, Tensor]:
    """Select the scene points that distances are measured to, and their normals.

    If distances are along normals, points without a reliable normal are left out. If the floor is a plane, its points
    are left out.
    """
    points, normals = problem.scene_points, problem.scene_normals
    ones = points.new_ones(3)  # a matrix product sums three columns several times faster than .sum()
    length = normals.square() @ ones
    finite = torch.isfinite(points @ ones + length)
    if options.along_normals:
        finite = finite & (length > 0.5)
    if problem.floor_normal is not None and not options.floor_samples:
        offset = points.new_tensor(problem.floor_offset)
        finite = finite & (plane_height(points, problem.floor_normal, offset).abs() > _FLOOR_BAND_M)
    points, normals = points[finite], normals[finite]
    if problem.floor_normal is not None and problem.floor_points is not None and options.floor_samples:
        up = problem.floor_normal.expand_as(problem.floor_points)
        points, normals = torch.cat([points, problem.floor_points]), torch.cat([normals, up])
    return points, normals
