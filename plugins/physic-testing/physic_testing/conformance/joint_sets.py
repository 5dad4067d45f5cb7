"""True keypoints of a world in every joint set that a detector may answer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.worlds import World

__all__ = ["world_keypoints"]


def world_keypoints(world: World, skeleton: str) -> tuple[FloatArray, BoolArray]:
    """Where the keypoints of a world's N people are, and which of them the photo shows.

    Args:
        world: knows its people's bodies.
        skeleton: a key of :data:`physic_core.body.landmarks.DETECTED`.

    Returns:
        (N, J, 2) float64 px and (N, J) bool. Points that no body has lie at the nose.

    Raises:
        KeyError: there is no such joint set.
    """
    if skeleton in world.keypoints:
        return world.keypoints[skeleton], world.visible[skeleton]

    import torch

    from physic_core.body import load_body
    from physic_core.body.landmarks import DETECTED, known_part
    from physic_testing.worlds.truth import project

    model = load_body(world.body_model)
    known, columns = known_part(skeleton)
    regressor = model.regressors[known]
    vertices = torch.from_numpy(world.vertices.copy()).index_select(1, regressor.vertex_ids)
    shown = project(regressor(torch.from_numpy(world.joints.copy()), vertices).double().numpy(), world.intrinsics)
    seen = np.stack([_visible(world, name) for name in (DETECTED[skeleton][i] for i in columns)], 1)
    nose = 0  # of COCO's sets, and all that are left are COCO's with more
    points = np.repeat(shown[:, [nose]], len(DETECTED[skeleton]), axis=1)
    visible = np.repeat(seen[:, [nose]], len(DETECTED[skeleton]), axis=1)
    points[:, columns], visible[:, columns] = shown, seen
    for row, name in enumerate(DETECTED[skeleton]):
        if name.endswith("hand_root"):
            wrist = columns.index(DETECTED[skeleton].index(name.replace("hand_root", "wrist")))
            points[:, row], visible[:, row] = shown[:, wrist], seen[:, wrist]
    return points, visible


def _visible(world: World, name: str) -> BoolArray:
    """(N,) bool of one point of a body; the tip of a finger goes with its last joint."""
    from physic_core.body import JOINT_INDEX
    from physic_core.body.landmarks import SKELETONS

    for skeleton in ("coco23", "blazepose33"):
        if name in SKELETONS[skeleton]:
            found: BoolArray = world.visible[skeleton][:, SKELETONS[skeleton].index(name)]
            return found
    joint = name.removesuffix("_tip") + "3" if name.endswith("_tip") else name
    return world.joints_visible[:, JOINT_INDEX[joint]]
