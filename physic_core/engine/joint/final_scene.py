"""Final scene after stage 3: inpainted points moved out of people."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.problem import JointProblem, JointResult
from physic_core.engine.scene.cleaning import edge_ratio
from physic_core.engine.scene.method import SceneMethod
from physic_core.engine.scene.solve import SceneState
from physic_core.geometry.free_space import move_behind_bodies
from physic_core.geometry.pointmap import pointmap_normals


def finalize_scene(
    scene: SceneState, problem: JointProblem, result: JointResult, hole: Tensor, settings: SceneMethod
) -> tuple[SceneState, JointProblem]:
    """Return the scene after the joint optimisation, and the problem with the points and the depth of that scene.

    The scene's scale is not applied. Inpainted points inside people are moved out.

    Args:
        hole: (H, W) bool, inpainted pixels.
    """
    s = result.scene_scale
    finite = torch.isfinite(result.vertices).flatten(1).all(1)
    if settings.carve_m and bool(finite.any()):
        scene = _carved(scene, result.vertices[finite] / s, problem.model.faces, problem.masks[finite], hole, settings)
    points, normals = scene.surface
    problem = replace(
        problem,
        scene_points=points.to(problem.scene_points),
        scene_normals=normals.to(problem.scene_normals),
        scene_depth=None if problem.scene_depth is None else scene.depth.to(problem.scene_depth),
    )
    return scene, problem


def _carved(
    scene: SceneState, bodies: Tensor, faces: Tensor, masks: Tensor, hole: Tensor, settings: SceneMethod
) -> SceneState:
    """Move inpainted scene points out of the bodies (B, V, 3) that occluded them."""
    unseen = hole & scene.valid
    moved, out = move_behind_bodies(scene.points[unseen], bodies, faces, masks[:, unseen], settings.carve_m)
    points = scene.points.clone()
    points[unseen] = moved
    changed = unseen.clone()
    changed[unseen] = out
    if not bool(out.any()):
        return scene
    rows, columns = (_span(changed.any(dim)) for dim in (1, 0))
    ratio = edge_ratio(*hole.shape)
    fresh = pointmap_normals(points[rows, columns], scene.valid[rows, columns], ratio)
    renewed = changed[rows, columns] & (fresh.square().sum(-1) > 0)
    surface = scene.normals.clone()
    surface[rows, columns] = torch.where(renewed[..., None], fresh, surface[rows, columns])
    return replace(scene, points=points, normals=surface)


def _span(hit: Tensor) -> slice:
    """Return the span of the true elements of ``hit`` (n,) with one neighbour on each side."""
    at = hit.nonzero()
    return slice(max(0, int(at[0]) - 1), int(at[-1]) + 2)
