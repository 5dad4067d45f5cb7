"""UsdSkel: skeleton, skinning weights, T-pose and pose of a person."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import roma
import torch

from physic_core.visual.glb import skin_influences
from physic_export.t_pose import t_pose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.visual.rig import Rig


def add_skeleton(stage: Any, path: str, mesh: Any, rig: Rig, up: NDArray[np.float64]) -> None:
    """Add ``skeleton`` and ``animation`` to a SkelRoot, and bind its mesh to them.

    Args:
        stage: the stage.
        path: of the SkelRoot, whose frame is that of the rig.
        mesh: in the bind pose.
        rig: in the pose.
        up: (3,) unit vector.
    """
    from pxr import Gf, UsdSkel, Vt

    standing = t_pose(rig, up)
    joints = _paths(rig)
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/skeleton")
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateBindTransformsAttr(_matrices(np.linalg.inv(rig.inverse_bind)))
    rest = np.tile(np.eye(4), (len(rig.names), 1, 1))
    rest[:, :3, :3], rest[:, :3, 3] = standing.rotations, standing.offsets
    skeleton.CreateRestTransformsAttr(_matrices(rest))
    animation = UsdSkel.Animation.Define(stage, f"{path}/animation")
    animation.CreateJointsAttr(joints)
    translations, rotations = animation.CreateTranslationsAttr(), animation.CreateRotationsAttr()
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * len(joints)))
    for time, posed in ((None, rig), (0, standing), (1, rig)):
        places = Vt.Vec3fArray.FromNumpy(posed.offsets.astype(np.float32))
        turns = roma.rotmat_to_unitquat(torch.from_numpy(posed.rotations)).numpy()
        quaternions = Vt.QuatfArray([Gf.Quatf(float(w), float(x), float(y), float(z)) for x, y, z, w in turns])
        for attribute, value in ((translations, places), (rotations, quaternions)):
            attribute.Set(value) if time is None else attribute.Set(value, time)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    indices, weights = skin_influences(rig.weights)
    count = indices.shape[1]
    binding.CreateJointIndicesPrimvar(False, count).Set(Vt.IntArray.FromNumpy(indices.reshape(-1).astype(np.int32)))
    binding.CreateJointWeightsPrimvar(False, count).Set(Vt.FloatArray.FromNumpy(weights.reshape(-1)))


def _paths(rig: Rig) -> list[str]:
    """Return the path of each joint, such as "pelvis/left_hip/left_knee"."""
    paths: list[str] = []
    for name, parent in zip(rig.names, rig.parents, strict=True):
        paths.append(name if parent < 0 else f"{paths[parent]}/{name}")
    return paths


def _matrices(matrices: NDArray[np.floating[Any]]) -> Any:
    """Return (n, 4, 4) matrices as USD has them: it multiplies row vectors from the left."""
    from pxr import Gf, Vt

    return Vt.Matrix4dArray([Gf.Matrix4d(*one.T.reshape(-1).tolist()) for one in matrices])
