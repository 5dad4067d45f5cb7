"""BVH: skeleton, T-pose and pose of each person in metres."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry import rotmat_to_euler
from physic_export.skeleton import named_rig, t_pose
from physic_visual.rig import Rig, rigs

if TYPE_CHECKING:
    from physic_core.types import Float64Array

_AXES = "ZXY"
"""Of the rotation channels, which BVH applies in this order: R = Rz Rx Ry."""

_END_M = 0.02
"""Length of a bone without children, metres: BVH demands one."""


def export_bvh(request: ExportRequest) -> ExportedFiles:
    """Return one BVH file per person: T-pose offsets in metres, rotations z, x, y in degrees.

    Frame 0 is a T-pose, frame 1 the pose. The option ``names`` selects the names of the joints.
    """
    style = str(request.options["names"])
    up = request.frame.up_vector
    files = {}
    for index, rig in rigs(request):
        named = named_rig(rig, style, up)
        files[request.file_of(index)] = _bvh_document([t_pose(named, up), named]).encode("ascii")
    return ExportedFiles(
        files,
        ("lengths are meters: a program that counts in centimeters imports them with scale 100",),
    )


def _bvh_document(motion: list[Rig]) -> str:
    """Return the text of a motion, a rig per frame; frames differ in their pose alone."""
    lines = ["HIERARCHY"]
    order: list[int] = []
    _write_joint(motion[-1], 0, 0, lines, order)
    lines += ["MOTION", f"Frames: {len(motion)}", "Frame Time: 0.0333333"]
    for posed in motion:
        angles = np.rad2deg(rotmat_to_euler(_AXES, posed.rotations[order]))
        place = posed.offsets[0] + posed.offsets[1] - motion[-1].offsets[1]
        lines.append(" ".join(_number(n) for n in [*place, *angles.reshape(-1)]))
    return "\n".join([*lines, ""])


def _write_joint(rig: Rig, joint: int, depth: int, lines: list[str], order: list[int]) -> None:
    """Append the lines of a joint and its children, and their indices in this order."""
    order.append(joint)
    indent = "\t" * depth
    offset: Float64Array = rig.offsets[joint] if depth else np.zeros(3)
    position = "Xposition Yposition Zposition " if not depth else ""
    channels = " ".join(f"{axis}rotation" for axis in _AXES)
    lines += [
        f"{indent}{'JOINT' if depth else 'ROOT'} {rig.names[joint]}",
        f"{indent}{{",
        f"{indent}\tOFFSET {' '.join(map(_number, offset))}",
        f"{indent}\tCHANNELS {6 if not depth else 3} {position}{channels}",
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
