"""Put what people hold where their hands are. OpenCV camera frame, metres.

A depth map gives a thin thing the depth of what is behind it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.geometry.pointmap import depth_to_pointmap
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.engine.state import Estimates, State


def without_held_things(estimates: Estimates, state: State) -> State:
    """Return the state without the scene's pixels of what people hold, which is not the world."""
    held = estimates.photo.held
    if held is None:
        return state
    thing = held.flatten(0, 1).any(0)
    return replace(state, scene=replace(state.scene, valid=state.scene.valid & ~thing))


def move_held_things(estimates: Estimates, state: State) -> State:
    """Return the state with the scene's pixels of what people hold at the depth of the hand.

    Args:
        estimates: with the masks of these things.
        state: with the final bodies; the scene's scale is not applied.
    """
    held = estimates.photo.held
    if held is None:
        return state
    scene = state.scene
    held = held & state.finite_people[:, None, None, None]
    moved = held.flatten(0, 1).any(0)
    depth = scene.points[..., 2].clone()
    knuckles = [JOINT_INDEX[f"{side}_middle1"] for side in SIDES]
    hands = state.joints[:, knuckles, 2].to(depth) / state.scene_scale
    for person, side in held.flatten(2).any(2).nonzero().tolist():
        depth[held[person, side]] = hands[person, side]
    placed = depth_to_pointmap(depth, scene.K.to(depth))
    changed = replace(
        scene,
        points=torch.where(moved[..., None], placed, scene.points),
        normals=scene.normals.masked_fill(moved[..., None], 0.0),
        valid=scene.valid | moved,
    )
    return replace(state, scene=changed)
