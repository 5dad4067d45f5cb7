"""Legs that no photo shows: a guessed pose does not pass far through the floor."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.engine.state import State
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.types.skeletons import SIDES

_HIPS, _KNEES, _ANKLES = (list(joint_pair(name)) for name in ("hip", "knee", "ankle"))
# Depth that a leg keeps below the floor, which is no better known: to raise a foot by 2 cm, a
# straight knee bends by 25 degrees.
_KEPT_M = 0.05
_MOST_RAD = 1.4  # fold of a thigh; a leg is then a sixth of its length high
_HALVINGS = 8  # of that range: to a third of a degree, or 5 mm at the sole


@torch.no_grad()
def fold_hidden_legs(state: State) -> State:
    """Return the state with hidden legs folded at hip and knee until the foot is no farther than 5
    cm under the floor.

    A leg is hidden if no photo shows its knee or ankle, and the user does not give the body. The
    foot stays below the hip, and as it is turned. Vertices and joints are those of the folded
    bodies.

    Args:
        state: after the joint optimisation.
    """
    if state.scene.floor is None:
        return state
    observed = state.observed_in_any_photo
    hidden = ~(observed[:, _KNEES] | observed[:, _ANKLES]) & ~state.is_given[:, None]
    fold = hidden & (_sole_heights(state) < -_KEPT_M)
    if not fold.any():
        return state
    lower = torch.zeros_like(fold, dtype=state.transl.dtype)
    upper = torch.where(fold, _MOST_RAD, lower)
    for _ in range(_HALVINGS):
        middle = (lower + upper) / 2
        under = _sole_heights(_folded(state, middle)) < -_KEPT_M
        lower = torch.where(under, middle, lower)
        upper = torch.where(under, upper, middle)
    return _folded(state, upper)


def _folded(state: State, angle: Tensor) -> State:
    """Return the state with both legs (N, 2) folded by an angle at the hip, radians, and by twice
    the angle at the knee.
    """
    rotations = state.rotations.clone()
    for joints, factor in ((_HIPS, -1.0), (_KNEES, 2.0), (_ANKLES, -1.0)):
        about_x = torch.nn.functional.pad((factor * angle)[..., None], (0, 2))
        rotations[:, joints] = rotations[:, joints] @ rotvec_to_rotmat(about_x)
    posed = state.model(rotations, state.betas, state.transl, state.expression)
    assert state.joint is not None
    joint = replace(state.joint, vertices=posed.vertices, joints=posed.joints)
    return replace(state, rotations=rotations, joint=joint)


def _sole_heights(state: State) -> Tensor:
    """Return the height (N, 2) of the lowest vertex of each foot over the floor, metres."""
    floor = state.scene.floor
    assert floor is not None
    height = (
        state.vertices @ floor.normal.to(state.vertices)
        + floor.offset * state.unapplied_scene_scale
    )
    feet = [state.model.part_mask(f"{side}_foot") for side in SIDES]
    return torch.stack([height[:, foot].amin(1) for foot in feet], 1)
