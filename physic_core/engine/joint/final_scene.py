"""The scene and its people: what stage 2 shows to be no floor, and what stage 3 leaves of the scene."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.engine.joint.local_depth_scale import log_factor
from physic_core.engine.joint.problem import JointProblem, JointResult
from physic_core.engine.scene.build import SceneState, edge_ratio_at
from physic_core.engine.scene.floor_below_people import cuts_people, floor_under_people
from physic_core.engine.settings import SceneSettings
from physic_core.geometry.carving import carved
from physic_core.geometry.plane import sample_plane
from physic_core.geometry.pointmap import normals

__all__ = ["is_furniture", "settled", "without_floor"]

_ANKLES = joint_pair("ankle")


def is_furniture(scene: SceneState, problem: JointProblem) -> bool:
    """Whether the floor is one that no segmenter called so, and goes through the people."""
    if scene.floor is None or scene.floor.source == "floor mask":
        return False
    body = problem.model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0)
    return cuts_people(body.vertices, scene.floor.normal, scene.floor.offset)


def without_floor(scene: SceneState) -> SceneState:
    """The same, told to have found none."""
    told = {**scene.diagnostics, "floor": {**scene.diagnostics["floor"], "reason": "through_people"}}
    none = scene.floor_points[:0]
    return replace(scene, floor=None, floor_normal=None, floor_offset=0.0, floor_points=none, diagnostics=told)


def settled(
    scene: SceneState, problem: JointProblem, result: JointResult, hole: Tensor, settings: SceneSettings
) -> tuple[SceneState, JointProblem]:
    """The scene as stage 3 leaves it, but for its scale: warped round the people, made up nowhere inside them, and with
    a floor under them.

    A warp leaves normals as they are: it turns them by few degrees, half a metre and more from a person.
    """
    s = result.scene_scale
    whole = torch.isfinite(result.vertices).flatten(1).all(1)
    if bool(result.warp.any()):
        bodies, warps = (x[whole].to(scene.points) for x in (result.vertices / s, result.warp))
        log = log_factor(scene.points, bodies, warps, scene.floor_normal, scene.floor_offset)
        scene = replace(scene, points=scene.points * log.exp()[..., None])
    if settings.carve_m and bool(whole.any()):
        scene = _carved(scene, result.vertices[whole] / s, problem.model.faces, problem.masks[whole], hole, settings)
    problem = replace(
        problem,
        scene_points=scene.points[scene.valid].to(problem.scene_points),
        scene_normals=scene.normals[scene.valid].to(problem.scene_normals),
        scene_depth=None if problem.scene_depth is None else scene.depth.to(problem.scene_depth),
    )
    if scene.floor_normal is None and settings.floor_under_people and bool(whole.any()):
        under = floor_under_people(
            result.vertices / s,
            result.joints / s,
            torch.cat([problem.model.contact_sets[f"{side}_sole"] for side in ("left", "right")]),
            problem.scene_points,
            problem.scene_normals,
            settings.floor_firmness,
        )
        if under is not None:
            scene = _with_floor(scene, *under, result.joints[whole][:, _ANKLES].flatten(0, 1) / s, settings)
            problem = replace(
                problem,
                floor_normal=under[0],
                floor_offset=under[1],
                floor_points=scene.floor_points.to(problem.scene_points),
            )
    return scene, problem


def _carved(
    scene: SceneState, bodies: Tensor, faces: Tensor, masks: Tensor, hole: Tensor, settings: SceneSettings
) -> SceneState:
    """Without scene inside the bodies that hid it."""
    unseen = hole & scene.valid
    moved, out = carved(scene.points[unseen], bodies, faces, masks[:, unseen], settings.carve_m)
    points = scene.points.clone()
    points[unseen] = moved
    changed = unseen.clone()
    changed[unseen] = out
    fresh = normals(points, scene.valid, edge_ratio_at(settings.edge_ratio, *hole.shape))
    changed &= fresh.square().sum(-1) > 0
    return replace(scene, points=points, normals=torch.where(changed[..., None], fresh, scene.normals))


def _with_floor(
    scene: SceneState, normal: Tensor, offset: float, ankles: Tensor, settings: SceneSettings
) -> SceneState:
    up = normal.to(scene.points)
    points = sample_plane(
        up,
        offset,
        scene.points[scene.valid],
        centres=ankles.to(up) - (ankles.to(up) @ up + offset)[:, None] * up,
        spacing=settings.floor_spacing_m,
        near=settings.floor_near_m,
        max_points=settings.floor_max_points,
    )
    told = {**scene.diagnostics, "floor": {**scene.diagnostics["floor"], "source": "people"}}
    return replace(scene, floor_normal=up, floor_offset=offset, floor_points=points, diagnostics=told)
