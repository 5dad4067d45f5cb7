"""BVH: skeleton, T-pose and pose of each person, in metres."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry.rotations import rotmat_to_euler
from physic_core.visual.rig import Rig, rigs
from physic_export.skeleton import bone_names, t_pose

if TYPE_CHECKING:
    from numpy.typing import NDArray

_END_M = 0.02
"""Length of a bone without children, metres: BVH demands one."""


def export_bvh(request: ExportRequest) -> ExportedFiles:
    """Return one BVH file per person: T-pose offsets in metres, rotations z, x, y in degrees.

    Frame 0 is a T-pose, frame 1 the pose. The option ``names`` selects the names of the joints.
    """
    names = bone_names(str(request.options["names"]))
    up = request.frame.up_vector
    files = {
        request.file_of(index): _document(replace(rig, names=names), up).encode("ascii")
        for index, rig in rigs(request)
    }
    return ExportedFiles(
        files,
        ("lengths are metres: a program that counts in centimetres imports them with scale 100",),
    )


def _document(rig: Rig, up: NDArray[np.float64]) -> str:
    lines = ["HIERARCHY"]
    order: list[int] = []
    _write_joint(rig, 0, 0, lines, order)
    lines += ["MOTION", "Frames: 2", "Frame Time: 0.0333333"]
    for posed in (t_pose(rig, up), rig):
        # These are the angles of R = Rz Rx Ry, the order in which BVH applies its channels.
        angles = np.rad2deg(rotmat_to_euler("ZXY", posed.rotations[order]))
        lines.append(" ".join(_number(n) for n in [*posed.offsets[0], *angles.reshape(-1)]))
    return "\n".join([*lines, ""])


def _write_joint(rig: Rig, joint: int, depth: int, lines: list[str], order: list[int]) -> None:
    """Append the lines of a joint and its children, and their indices in this order."""
    order.append(joint)
    indent = "\t" * depth
    offset: NDArray[np.float64] = rig.offsets[joint] if depth else np.zeros(3)
    position = "Xposition Yposition Zposition " if not depth else ""
    lines += [
        f"{indent}{'JOINT' if depth else 'ROOT'} {rig.names[joint]}",
        f"{indent}{{",
        f"{indent}\tOFFSET {' '.join(map(_number, offset))}",
        f"{indent}\tCHANNELS {6 if not depth else 3} {position}Zrotation Xrotation Yrotation",
    ]
    children = [child for child, parent in enumerate(rig.parents) if parent == joint]
    for child in children:
        _write_joint(rig, child, depth + 1, lines, order)
    if not children:
        length = np.linalg.norm(offset)
        end = offset / length * _END_M if length > 0 else np.array([0.0, _END_M, 0.0])
        lines += [
            f"{indent}\tEnd Site",
            f"{indent}\t{{",
            f"{indent}\t\tOFFSET {' '.join(map(_number, end))}",
        ]
        lines.append(f"{indent}\t}}")
    lines.append(f"{indent}}}")


def _number(value: float) -> str:
    return f"{value:.6f}"
