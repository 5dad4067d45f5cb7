"""What stays as it is for a whole run of the joint optimisation: tracked vertices, keypoints, units, the surface."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel, BodyOutput, LandmarkModel
from physic_core.engine.joint.limbs import keypoint_weights, observed_parts, seen_keypoints, stands
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.released_reprojection import released_keypoint_weights
from physic_core.engine.joint.terms import plane_height, root_relative
from physic_core.engine.settings import JointSettings
from physic_core.geometry.camera import project
from physic_core.geometry.coarse_mesh import clusters
from physic_core.geometry.free_space import fronts
from physic_core.geometry.visibility import inside_image, vertex_areas

__all__ = ["STATIC_CONTACTS", "Fixed", "prepare", "representatives", "seen_joints"]

STATIC_CONTACTS = ("left_foot", "right_foot", "left_hand", "right_hand", "thighs", "gluteus", "back")
"""What usually touches the world, after PROX."""

_FULL_HD_PX = 1920
_LEGS = [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("knee", "ankle")]
_BORDER_SHARE = 0.05  # of the person
_GRID = float(1 << 20)  # steps a metre
_AREA_UNIT_M2 = 0.01  # a square decimetre, half a sole: the surface that counts once


@dataclass(frozen=True)
class Fixed:
    """See the module. n are the tracked vertices.

    Attributes:
        ids: (n,) int64 of the tracked vertices.
        faces_around: their rows of the body's.
        pose: poses keypoints, joints and tracked vertices alone.
        area: (B, n) surface that each tracked vertex stands for, square decimetres; ones where vertices are counted.
        prior: (B, n) contact probability, or 1 where vertices are counted; 0 below the threshold.
        seen_part: (B, n) bool, on a limb that the photo shows.
        over_knees: (n,) bool, on neither a lower leg nor a foot.
        soles: rows of ``ids`` of the left and of the right sole; empty where the body has none.
        keypoints: (B, J, 2) px, finite.
        keypoint_weight: (B, J).
        confident: (B, J) bool, sure keypoints on limbs that the photo shows.
        unit: (B, 1 or 2) px of a 2D error of one sigma.
        person_px: (B,) stature in px at the person's depth.
        relative: (B, n, 3) tracked vertices at the start in the root's frame, metres.
        stands: (B,) bool.
        legs_unseen: (B,) bool, neither knees nor ankles are shown.
        feet_seen: (B, 2) bool.
        log_depth: (H, W) logarithm of the original photo's depth, NaN where unknown; or None.
        fronts: of the scene, see :mod:`physic_core.geometry.free_space`; None where free space is not told.
        surface: scene points that count as surface, (M, 3) metres.
        surface_normals: (M, 3).
    """

    ids: Tensor
    faces_around: Tensor
    pose: LandmarkModel
    area: Tensor
    prior: Tensor
    seen_part: Tensor
    over_knees: Tensor
    soles: tuple[Tensor, Tensor]
    keypoints: Tensor
    keypoint_weight: Tensor
    confident: Tensor
    unit: Tensor
    person_px: Tensor
    relative: Tensor
    stands: Tensor
    legs_unseen: Tensor
    feet_seen: Tensor
    log_depth: Tensor | None
    fronts: Tensor | None
    surface: Tensor
    surface_normals: Tensor


def prepare(problem: JointProblem, settings: JointSettings, start: BodyOutput) -> Fixed:
    """Gather it.

    Args:
        problem: with finite people only.
        settings: of stage 3.
        start: the posed bodies at the start, all vertices.
    """
    model, observed = problem.model, seen_joints(problem, settings)
    height, width = problem.masks.shape[-2:]
    probability = torch.nan_to_num(problem.contact_probability)
    if settings.contact_source == "static":
        probability = torch.zeros_like(probability)
        for name in STATIC_CONTACTS:
            probability[:, model.contact_sets[name]] = 1.0
    expected = probability >= settings.contact_probability
    # Where vertices are counted, a contact vertex counts 1 whatever its probability (Eq. 6).
    count = torch.ones_like(probability) if settings.reduction == "sum" else probability
    prior = torch.where(expected, count, torch.zeros_like(probability))
    if settings.contact_static_weight:
        for name in STATIC_CONTACTS:
            rows = model.contact_sets[name]
            prior[:, rows] = prior[:, rows].clamp(min=settings.contact_static_weight)
    area = vertex_areas(start.vertices, model.faces)
    ids, area = representatives(model, expected.any(0), settings.vertex_spacing_m, area)
    area = area / _AREA_UNIT_M2 if settings.reduction == "area" else torch.ones_like(area)
    ankles = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
    person_px = problem.K[1, 1] * model.stature(problem.betas0) / start.joints[:, 0, 2].clamp(min=0.1)
    keypoints, keypoint_weight, confident = _keypoints(problem, settings, person_px)
    unit = person_px[:, None]
    if settings.reprojection_unit == "image":
        unit = person_px.new_tensor([[width, height]]).expand(len(problem), 2)
    elif settings.reprojection_unit == "full_hd":
        unit = torch.full_like(unit, max(width, height) / _FULL_HD_PX)
    surface, surface_normals = _surface(problem, settings)
    return Fixed(
        ids=ids,
        faces_around=model.faces_around[ids],
        pose=model.landmarks_only([problem.skeleton], ids),
        area=area,
        prior=prior[:, ids],
        seen_part=observed_parts(model.part_names, observed)[:, model.part_of_vertex[ids]],
        over_knees=_over_knees(model)[ids],
        soles=_sole_rows(model, ids),
        keypoints=keypoints,
        keypoint_weight=keypoint_weight,
        confident=confident,
        unit=unit * settings.reprojection_sigma,
        person_px=person_px,
        relative=root_relative(start.vertices[:, ids], start.joints[:, 0], problem.rotations0[:, 0]),
        stands=stands(problem.rotations0, start.joints, observed, problem.floor_normal),
        legs_unseen=~observed[:, _LEGS].any(1),
        feet_seen=observed[:, ankles] & inside_image(project(start.joints[:, ankles], problem.K), height, width),
        log_depth=_log_depth(problem.human_depth),
        fronts=fronts(problem.scene_depth) if settings.free_space and problem.scene_depth is not None else None,
        surface=surface,
        surface_normals=surface_normals,
    )


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


def _keypoints(problem: JointProblem, settings: JointSettings, person_px: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """(B, J, 2) px without anything that is not a number, how much each counts (B, J), and which are sure (B, J)."""
    points, confidence = problem.keypoints, problem.keypoint_confidence
    height, width = problem.masks.shape[-2:]
    finite = torch.isfinite(points).all(-1) & torch.isfinite(confidence)
    points = torch.where(finite[..., None], points, torch.zeros_like(points))
    confidence = torch.where(finite, confidence, torch.zeros_like(confidence))
    seen = seen_keypoints(problem.skeleton, seen_joints(problem, settings), points.shape[1])
    if settings.reprojection_form == "released":
        weight = released_keypoint_weights(problem.skeleton, points, confidence, problem.masks)
        return points, weight, seen & (weight > 0)
    weight = torch.where(confidence < settings.min_confidence, settings.low_confidence_weight * confidence, confidence)
    # A guess is never sure. What is cut off at the border, some detectors put just inside.
    from_border = torch.minimum(points, points.new_tensor([width, height]) - points).amin(-1)
    off_border = from_border > _BORDER_SHARE * person_px[:, None]
    weight = torch.where(seen, weight, settings.unseen_keypoint_weight * confidence * off_border)
    if settings.confidence_power != 1:
        weight = weight**settings.confidence_power
    # What a network puts outside the picture it has made up.
    weight = weight * inside_image(points, height, width)
    weight = weight * weight.new_tensor(keypoint_weights(problem.skeleton, points.shape[1]))
    return points, weight, seen & (weight >= settings.min_confidence)


def seen_joints(problem: JointProblem, settings: JointSettings) -> Tensor:
    """(B, 55) bool, joints that the photo shows; all of them where the settings ask nothing."""
    return problem.observed.bool() if settings.observed else torch.ones_like(problem.observed, dtype=torch.bool)


def _log_depth(depth: Tensor | None) -> Tensor | None:
    if depth is None:
        return None
    return torch.where(depth > 0, depth, torch.full_like(depth, torch.nan)).log()


def _surface(problem: JointProblem, settings: JointSettings) -> tuple[Tensor, Tensor]:
    """Scene points to measure against. Without a reliable normal a point has no inside: it is left out where
    distances are taken along normals; and where the floor is a plane, its points are left to the plane."""
    points, normals = problem.scene_points, problem.scene_normals
    ones = points.new_ones(3)  # a product sums three columns several times faster than a sum does
    length = normals.square() @ ones
    finite = torch.isfinite(points @ ones + length)
    if settings.contact_metric == "plane":
        finite = finite & (length > 0.5)
    if problem.floor_normal is not None and settings.floor == "plane":
        offset = points.new_tensor(problem.floor_offset)
        finite = finite & (plane_height(points, problem.floor_normal, offset).abs() > settings.floor_band_m)
    points, normals = points[finite], normals[finite]
    if problem.floor_normal is not None and problem.floor_points is not None and settings.floor == "points":
        up = problem.floor_normal.expand_as(problem.floor_points)
        points, normals = torch.cat([points, problem.floor_points]), torch.cat([normals, up])
    return points, normals
