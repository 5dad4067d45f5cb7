"""Settings and problems with some values changed, for tests: ``adjusted(joint,
contact__weight=0.0)``.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, TypeVar

import torch

from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.method import JointMethod
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.settings import with_overrides

Settings = TypeVar("Settings")
T = TypeVar("T")


def adjusted(settings: Settings, **changes: Any) -> Settings:
    """A double underscore leads into the settings of a term."""
    overrides: dict[str, Any] = {}
    for path, value in changes.items():
        *tables, name = path.split("__")
        place = overrides
        for table in tables:
            place = place.setdefault(table, {})
        place[name] = value
    return with_overrides(settings, overrides)


def without_photo(problem: JointProblem) -> JointProblem:
    """Return the problem without keypoints, depth, scene and floor."""
    nothing = torch.zeros(0, 3)
    return replace(
        problem,
        keypoint_confidence=torch.zeros_like(problem.keypoint_confidence),
        floor_normal=None,
        scene_points=nothing,
        scene_normals=nothing,
        human_depth=None,
    )


def in_float64(problem: JointProblem) -> JointProblem:
    """Return the problem with body and all numbers in double precision."""
    tensors = {f.name: getattr(problem, f.name) for f in fields(problem)}
    double = {
        n: t.double()
        for n, t in tensors.items()
        if isinstance(t, torch.Tensor) and t.is_floating_point()
    }
    return replace(problem, model=problem.model.to(dtype=torch.float64), **double)


def with_options(joint: JointMethod, **changes: Any) -> JointMethod:
    """Settings of stage 3 whose energy has some other methods."""
    Other = type("Other", (type(joint),), changes)
    return Other(**{f.name: getattr(joint, f.name) for f in fields(joint)})


def term_of(energy: JointEnergy, kind: type[T]) -> T:
    """The one term of a class."""
    (found,) = (term for term in energy.terms if isinstance(term, kind))
    return found
