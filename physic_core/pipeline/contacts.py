"""Input of the contact stage, from the estimates and the results of stages 1 to 3."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import torch

from physic_core.engine.contact.distance import contact_surfaces
from physic_core.engine.contact.objects import HeldObjects
from physic_core.engine.contact.problem import ContactInput
from physic_core.engine.contact.scene_parts import ClassifiedPoints
from physic_core.engine.placement.lifted_feet import depth_gaps_at_feet
from physic_core.engine.placement.people import Detections
from physic_core.geometry.free_space import front_depth, in_free_space
from physic_core.geometry.tensors import tensor
from physic_core.pipeline.person_measures import depth_ratios

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.engine.joint.problem import JointProblem, JointResult
    from physic_core.engine.scene.solve import SceneState
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates

__all__ = ["classify_points", "contact_input"]


def classify_points(estimates: Estimates, scene: SceneState) -> ClassifiedPoints:
    """Return the classes of the valid scene points, all unknown if the segmenter labels no surfaces."""
    surfaces, seen = estimates.people.surfaces, ~tensor(estimates.hole)[scene.valid]
    uncarved = None if scene.uncarved is None else (scene.uncarved[0][scene.valid], scene.uncarved[1][scene.valid])
    if surfaces is None:
        return ClassifiedPoints(("unknown",), torch.zeros_like(seen, dtype=torch.int64), seen, uncarved)
    return ClassifiedPoints(surfaces.names, tensor(surfaces.labels).long()[scene.valid], seen, uncarved)


def contact_input(
    problem: JointProblem, result: JointResult, settings: EngineSettings, classes: ClassifiedPoints, objects: Tensor
) -> ContactInput:
    """Return the input of stage 4.

    Args:
        problem: of stage 3, with the final scene.
        result: of stage 3.
        settings: of the engine.
        classes: of ``problem.scene_points``.
        objects: (K, H, W) bool, visible pixels of objects in hands and on laps.
    """
    s, vertices = result.scene_scale, result.vertices
    points, normals = classes.uncarved or (problem.scene_points, problem.scene_normals)
    uncarved = replace(problem, scene_points=points.to(vertices), scene_normals=normals.to(vertices), floor_normal=None)
    finite = vertices[torch.isfinite(vertices).flatten(1).all(1)]
    free = None
    if settings.joint.energy_options.free_space and problem.scene_depth is not None:
        free = in_free_space(vertices / s, front_depth(problem.scene_depth), problem.K)
    lifted = problem.lifted_feet
    return ContactInput(
        model=problem.model,
        vertices=vertices,
        joints=result.joints,
        rotations=result.rotations,
        prior=problem.contact_probability,
        observed=problem.observed,
        lifted_feet=torch.zeros(len(problem), 2, dtype=torch.bool) if lifted is None else lifted,
        surfaces=contact_surfaces(problem, finite, s, settings),
        uncarved=contact_surfaces(uncarved, finite, s, settings).scene,
        classes=classes,
        plane=None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * s),
        free=free,
        objects=_held_objects(problem, result, objects),
        foot_gap=_foot_gaps(problem),
    )


def _foot_gaps(problem: JointProblem) -> Tensor | None:
    """Return the gap (N, 2) of depth behind each foot; None if a depth is unknown."""
    photo, scene = problem.human_depth, problem.scene_depth
    if photo is None or scene is None:
        return None
    shown = Detections(
        skeleton=problem.skeleton,
        keypoints=problem.keypoints,
        confidence=problem.keypoint_confidence,
        observed=None,
        points=(),
        masks=problem.masks,
    )
    return depth_gaps_at_feet(shown, photo.cpu(), scene.cpu(), torch.zeros_like(photo, dtype=torch.bool, device="cpu"))


def _held_objects(problem: JointProblem, result: JointResult, masks: Tensor) -> HeldObjects | None:
    """Return the objects in the photo; None without any, or if their depth is unknown."""
    if not len(masks) or problem.human_depth is None:
        return None
    depth = problem.human_depth * result.scene_scale
    ratios = [torch.nan if one is None else 1 / one for one in depth_ratios(problem, result)]
    return HeldObjects(masks.to(depth.device), depth, result.vertices.new_tensor(ratios), problem.K)
