"""Ground-truth keypoints of a world in any skeleton."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import Skeleton, skeleton_named
from physic_testing.worlds.skeletons import SKELETONS

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.worlds import World


def true_keypoints_px(world: World, skeleton: Skeleton | str) -> tuple[FloatArray, BoolArray]:
    """Return the keypoints of a world's N people in a skeleton, and their visibility in the photo.

    Args:
        world: world with at least one person.
        skeleton: a skeleton, or the name of one in :data:`physic_testing.worlds.SKELETONS` or of a
            standard one.

    Returns:
        (N, J, 2) float64 px and (N, J) bool. Keypoints that the body model lacks are placed at the
        nose, hand roots at the wrist.

    Raises:
        BodyModelError: a point of the skeleton is not defined on a body.
        ValueError: no skeleton has this name.
    """
    if isinstance(skeleton, str):
        skeleton = SKELETONS.get(skeleton) or skeleton_named(skeleton)
    if skeleton == SKELETONS.get(skeleton.name):
        return world.keypoints[skeleton.name], world.visible[skeleton.name]

    import torch

    from physic_core.body import load_body
    from physic_testing.worlds.world import project

    fitted = list(skeleton.fitted)
    regressor = load_body(world.body_model).regressor(skeleton.take(fitted))
    vertices = torch.from_numpy(world.vertices.copy()).index_select(1, regressor.vertex_ids)
    on_body = regressor(torch.from_numpy(world.joints.copy()), vertices)
    points = np.empty((len(world.joints), len(skeleton), 2))
    points[:, fitted] = project(on_body.double().numpy(), world.intrinsics)
    nearest = [_nearest_body_point(skeleton, name) for name in skeleton.names]
    for row in {*range(len(skeleton))} - {*fitted}:
        name = skeleton.names[row]
        is_root = name.endswith("hand_root")
        nearest[row] = name.replace("hand_root", "wrist") if is_root else "nose"
        column = SKELETONS["coco23"].names.index(nearest[row])
        points[:, row] = world.keypoints["coco23"][:, column]
    return points, np.stack([_visible(world, name) for name in nearest], axis=1)


def _nearest_body_point(skeleton: Skeleton, name: str) -> str:
    """Return the body point with the largest weight in a keypoint."""
    from physic_core.body import BODY_POINTS

    blend = skeleton.on_body.get(name, {})
    return name if name in BODY_POINTS else max(blend, key=blend.__getitem__, default="")


def _visible(world: World, name: str) -> BoolArray:
    """Return the visibility (N,) of one body point; a fingertip has the visibility of the finger's
    last joint.
    """
    from physic_core.body import JOINT_INDEX

    for skeleton in ("coco23", "blazepose33"):
        names = SKELETONS[skeleton].names
        if name in names:
            return world.visible[skeleton][:, names.index(name)]
    joint = name.removesuffix("_tip") + "3" if name.endswith("_tip") else name
    return world.joints_visible[:, JOINT_INDEX[joint]]
