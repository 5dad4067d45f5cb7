"""Settings and problems with some values changed, for tests: ``adjusted(joint,
contact__weight=0.0)``.
"""

from __future__ import annotations

from dataclasses import fields, replace

import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.settings import with_overrides
from physic_core.engine.state import JointResult
from physic_core.geometry.tensors import to_dtype


def adjusted(settings, **changes):
    """A double underscore leads into the settings of a term."""
    overrides = {}
    for path, value in changes.items():
        *tables, name = path.split("__")
        place = overrides
        for table in tables:
            place = place.setdefault(table, {})
        place[name] = value
    return with_overrides(settings, overrides)


def shifted(state, *metres):
    """Return the state with its people moved in x, y and z."""
    return replace(state, transl=state.transl + torch.tensor(metres))


def posed(state):
    """Return the bodies of the state, as its model poses them."""
    return state.model(state.rotations, state.betas, state.transl, state.expression)


def with_result(state, body):
    """Return the state with bodies as the result of stage 3."""
    people = len(state)
    joint = JointResult(body.vertices, body.joints, torch.zeros(people), ("",) * people)
    return replace(state, joint=joint)


def heights(state):
    """Return the height (N, V) of the vertices of stage 3 over the floor, metres."""
    floor = state.scene.floor
    return (
        state.vertices @ floor.normal.to(state.vertices)
        + floor.offset * state.unapplied_scene_scale
    )


def without_joints(state, *names, sides=("left", "right")):
    """Return the state of a photo that does not show some joints."""
    observed = state.observed.clone()
    observed[:, [JOINT_INDEX[f"{side}_{name}"] for side in sides for name in names]] = False
    return replace(state, observed=observed)


def without_photo(state):
    """Return the state without keypoints, depth, scene and floor."""
    return replace(
        state,
        keypoint_confidence=torch.zeros_like(state.keypoint_confidence),
        scene=replace(state.scene, valid=torch.zeros_like(state.scene.valid), floor=None),
        photo_depth=None,
    )


def with_scene(state, **changes):
    """Return the state with other values of its scene: fields of ``SceneState``, or the offset of
    the floor.
    """
    offset = changes.pop("floor_offset", None)
    scene = replace(state.scene, **changes)
    if offset is not None and scene.floor is not None:
        scene = replace(scene, floor=replace(scene.floor, offset=offset))
    return replace(state, scene=scene)


def with_points(state, points, normals):
    """Return the state with M points (M, 3) and their normals as its scene."""
    valid = torch.ones(len(points), 1, dtype=torch.bool)
    return with_scene(state, points=points[:, None], normals=normals[:, None], valid=valid)


def larger_scene(state, factor):
    """Return the state with its scene and the depth of its photo times a factor."""
    scene = state.scene
    floor = state.scene.floor
    larger = with_scene(state, points=factor * scene.points, floor_offset=factor * floor.offset)
    return replace(larger, photo_depth=factor * state.photo_depth)


def in_float64(state):
    """Return the state with body and all numbers in double precision."""
    return to_dtype(state, torch.float64)


def with_options(joint, **changes):
    """Settings of stage 3 whose energy has some other methods."""
    Other = type("Other", (type(joint),), changes)
    return Other(**{f.name: getattr(joint, f.name) for f in fields(joint)})


def term_of(energy, kind):
    """The one term of a class."""
    (found,) = (term for term in energy.terms if isinstance(term, kind))
    return found
