"""What each vertex is near to, and which vertices may touch, must not penetrate, or stand on the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import Fixed
from physic_core.engine.joint.local_depth_scale import warp_share
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.terms import lowest_height, plane_height, signed_distance
from physic_core.engine.joint.visibility import Visible
from physic_core.engine.settings import JointSettings
from physic_core.geometry.free_space import in_free_space
from physic_core.geometry.neighbors import NearestScene, near_boxes

__all__ = ["WANDER_M", "Touch", "feel", "scene_near"]

WANDER_M = 0.6  # how far people may move before the scene round them has to be gathered anew
_LEVEL = 0.7  # cosine: a surface that one can stand on
_UNSEEN = 4.0  # sigmas: a foot that should be so far off is not the floor's to mend
_SUNK_M = 0.2  # metres under the floor from which on unseen limbs are left alone
_STEP_SHARE = 0.3  # of a sole's vertices that must be over a raised surface
_LEAN_SHARE = 0.006  # of the skin, a palm over the knees on the scene: who leans so is not balanced over their feet
_STEP_M = 0.1  # metres over the floor: what is lower is the floor, as the point map bends it


@dataclass(frozen=True)
class Touch:
    """See the module. Weights are 0 where a vertex does not count.

    Attributes:
        near: (B, n) int64, nearest scene point.
        warp_share: (B, n) how much of their person's warp those points take.
        on_scene: (B, n) bool, contact is with the scene; else with the floor's plane.
        contact_weight: (B, n).
        penetration_weight: (B, n), against the scene.
        floor_weight: (B, n), against the floor's plane.
        sole_weight: (B, 2).
        lower_sole_weight: (B,).
        unseen_sole_weight: (B, 2).
        balanced: (B,) 1 for who stands on their feet alone.
    """

    near: Tensor
    warp_share: Tensor
    on_scene: Tensor
    contact_weight: Tensor
    penetration_weight: Tensor
    floor_weight: Tensor
    sole_weight: Tensor
    lower_sole_weight: Tensor
    unseen_sole_weight: Tensor
    balanced: Tensor


def scene_near(fixed: Fixed, settings: JointSettings, vertices: Tensor, scale: float) -> NearestScene:
    """The surface round the people (B, V, 3), wide enough for them to move, as a search structure."""
    reach = max(settings.contact_reach_m, settings.penetration_reach_m)
    if settings.nearest == "grid":  # whose nodes depend on the extent of the scene
        return NearestScene(fixed.surface, fixed.surface_normals, reach, "grid")
    keep = near_boxes(fixed.surface, vertices / scale, (reach + WANDER_M) / scale)
    return NearestScene(fixed.surface[keep], fixed.surface_normals[keep], reach, settings.nearest)


@torch.no_grad()
def feel(
    problem: JointProblem,
    settings: JointSettings,
    fixed: Fixed,
    visible: Visible,
    scene: NearestScene,
    vertices: Tensor,
    scale: float,
    warp: Tensor,
) -> Touch:
    """Look up nearest points and decide who counts.

    Args:
        problem: with finite people only.
        settings: of stage 3.
        fixed: what stays as it is.
        visible: what the photo shows.
        scene: from :func:`scene_near`.
        vertices: (B, n, 3) tracked vertices now, metres.
        scale: of the scene, now.
        warp: (B,) of what is round each person, now.
    """
    warped = vertices / warp.exp()[:, None, None]
    nearest = scene.query(warped, scale)
    far = torch.full_like(fixed.area, torch.inf)
    zeros = torch.zeros_like(fixed.area)
    nobody = torch.zeros_like(visible.in_play)
    signed, against_scene, level, lined, share = far, zeros, nobody, ~nobody, zeros
    free = nobody if fixed.fronts is None else in_free_space(warped / scale, fixed.fronts, problem.K)
    oblique = math.cos(math.radians(settings.contact_angle_deg)) if settings.contact_angle_deg < 90 else 0.0
    plane = problem.floor_normal if settings.floor == "plane" else None
    floor_offset = vertices.new_tensor(problem.floor_offset * scale)
    if len(scene.points):
        normals = scene.normals[nearest.index]
        share = warp_share(scene.points[nearest.index], problem.floor_normal, problem.floor_offset)
        points = scene.points[nearest.index] * (scale * torch.exp(warp[:, None] * share))[..., None]
        signed = torch.where(nearest.found, signed_distance(vertices, points, normals), far)
        against_scene = -(visible.normals * normals).sum(-1)
        lined = against_scene.abs() >= oblique
        if plane is not None:
            raised = plane_height(points, plane, floor_offset) > _STEP_M
            level = nearest.found & raised & ((normals @ plane) > _LEVEL)
    above, against_floor = far, zeros
    if plane is not None:
        above = plane_height(vertices, plane, floor_offset)
        against_floor = -(visible.normals @ plane)

    # Contact: the nearer of scene and floor. Behind an object only the floor is known.
    to_scene = signed.abs() if settings.contact_metric == "plane" else nearest.distance
    can_scene = nearest.found & (to_scene < settings.contact_reach_m)
    can_scene, can_floor = can_scene & lined, (above.abs() < settings.contact_reach_m)
    can_floor = can_floor & (against_floor.abs() >= oblique)
    if settings.contact_outside:
        can_scene, can_floor = can_scene & (signed > 0), can_floor & (above > 0)
    if settings.contact_facing:
        can_scene, can_floor = can_scene & (against_scene > 0), can_floor & (against_floor > 0)
    on_scene = can_scene & (~can_floor | (to_scene <= above.abs()))
    touching = can_scene | can_floor
    if settings.observed:
        touching = touching & visible.in_play
    contact_weight = fixed.area * fixed.prior
    if settings.contact_facing:
        # Only what faces a surface can lie on it: the rim of a foot is over the floor, and does not touch it.
        contact_weight = contact_weight * torch.where(on_scene, against_scene, against_floor).clamp(min=0.0)

    inside = nearest.found & (nearest.distance < settings.penetration_reach_m) & visible.in_play & ~free
    contact_weight = torch.where(touching, contact_weight, zeros)
    if settings.contact_mean:
        contact_weight = contact_weight / contact_weight.sum(1, keepdim=True).clamp(min=1e-9)
    if settings.occlusion_aware:
        inside = inside & (visible.in_mask if settings.penetration_self_occluded else ~visible.hidden)
    if settings.penetration_spares_contact:
        inside = inside & ~(fixed.prior > 0)

    # Whose unseen legs would stand deep in the floor has other legs, or another floor.
    shallow = above.amin(1, keepdim=True) > -_SUNK_M
    guessed = torch.where(shallow, settings.floor_unseen_share * fixed.area, zeros)

    heights = [above[:, rows] for rows in fixed.soles]
    lowest = torch.stack([lowest_height(h) if h.shape[1] else far[:, 0] for h in heights], 1)
    # A foot on a step or a stool stands on that, which contact sees to.
    stepped = torch.stack([_share((level & (signed.abs() < above))[:, rows]) > _STEP_SHARE for rows in fixed.soles], 1)
    on_floor = fixed.feet_seen & torch.isfinite(lowest) & ~stepped
    expected = fixed.prior >= settings.contact_probability
    likely = torch.stack([_share(expected[:, rows]) > 0 for rows in fixed.soles], 1)
    rests = expected & fixed.over_knees & touching & on_scene
    leans = (fixed.area * rests).sum(1) > _LEAN_SHARE * fixed.area.sum(1)
    lower = torch.where(on_floor, lowest, torch.full_like(lowest, torch.inf)).amin(1)
    pulled = (on_floor & likely).any(1) & ~stepped.any(1) & (lower.abs() < settings.lower_sole_reach_m)
    if problem.grounded is not None:
        pulled = pulled & problem.grounded
    return Touch(
        near=nearest.index,
        warp_share=share,
        on_scene=on_scene,
        contact_weight=contact_weight,
        penetration_weight=torch.where(inside, fixed.area, zeros),
        floor_weight=zeros if plane is None else torch.where(visible.in_play, fixed.area, guessed),
        sole_weight=on_floor.to(zeros.dtype),
        lower_sole_weight=pulled.to(zeros.dtype),
        unseen_sole_weight=(~fixed.feet_seen & (lowest.abs() < _UNSEEN * settings.unseen_sole_sigma_m) & ~stepped).to(
            zeros.dtype
        ),
        balanced=(fixed.stands & ~leans).to(zeros.dtype),
    )


def _share(flags: Tensor) -> Tensor:
    """(B, n) bool -> (B,) share that is set; 0 for n = 0."""
    return flags.sum(1) / max(1, flags.shape[1])
