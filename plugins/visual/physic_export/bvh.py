"""BVH: skeleton, T-pose and pose of each person in metres, or people as in the LAFAN1 data set."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.errors import InputError
from physic_core.geometry import rotmat_to_euler
from physic_export.lafan import as_lafan
from physic_export.skeleton import named_rig, t_pose
from physic_visual.rig import Rig, rigs

if TYPE_CHECKING:
    from numpy.typing import NDArray

_END_M = 0.02
"""Length of a bone without children, metres: BVH demands one."""


def export_bvh(request: ExportRequest) -> ExportedFiles:
    """Return one BVH file per person: T-pose offsets in metres, rotations z, x, y in degrees.

    Frame 0 is a T-pose, frame 1 the pose. The option ``names`` selects the names of the joints.
    With "lafan", both frames are the pose, in the joints, axes, centimetres and order of rotations
    of the LAFAN1 data set.

    Raises:
        InputError: "lafan" in a frame whose y axis is not up.
    """
    style = str(request.options["names"])
    up = request.frame.up_vector
    if style == "lafan":
        if up[1] != 1:
            raise InputError("names 'lafan' are of files with y up: leave out --up, or use --up y")
        motions = {index: [as_lafan(rig)] * 2 for index, rig in rigs(request)}
        return ExportedFiles(
            {
                request.file_of(index): _document(motion, "ZYX").encode("ascii")
                for index, motion in motions.items()
            },
            ("lengths are centimetres, as in the LAFAN1 data set",),
        )
    files = {}
    for index, rig in rigs(request):
        named = named_rig(rig, style, up)
        motion = [t_pose(named, up), named]
        files[request.file_of(index)] = _document(motion, "ZXY").encode("ascii")
    return ExportedFiles(
        files,
        ("lengths are metres: a program that counts in centimetres imports them with scale 100",),
    )


def _document(motion: list[Rig], axes: str) -> str:
    """Return the text of a motion whose frames differ in their pose alone.

    Args:
        motion: a rig for each frame.
        axes: of the rotation channels, such as "ZXY" for R = Rz Rx Ry, the order in which BVH
            applies its channels.
    """
    lines = ["HIERARCHY"]
    order: list[int] = []
    channels = " ".join(f"{axis}rotation" for axis in axes)
    _write_joint(motion[-1], 0, 0, channels, lines, order)
    lines += ["MOTION", f"Frames: {len(motion)}", "Frame Time: 0.0333333"]
    for posed in motion:
        angles = np.rad2deg(rotmat_to_euler(axes, posed.rotations[order]))
        place = posed.offsets[0] + posed.offsets[1] - motion[-1].offsets[1]
        lines.append(" ".join(_number(n) for n in [*place, *angles.reshape(-1)]))
    return "\n".join([*lines, ""])


def _write_joint(
    rig: Rig, joint: int, depth: int, channels: str, lines: list[str], order: list[int]
) -> None:
    """Append the lines of a joint and its children, and their indices in this order."""
    order.append(joint)
    indent = "\t" * depth
    offset: NDArray[np.float64] = rig.offsets[joint] if depth else np.zeros(3)
    position = "Xposition Yposition Zposition " if not depth else ""
    lines += [
        f"{indent}{'JOINT' if depth else 'ROOT'} {rig.names[joint]}",
        f"{indent}{{",
        f"{indent}\tOFFSET {' '.join(map(_number, offset))}",
        f"{indent}\tCHANNELS {6 if not depth else 3} {position}{channels}",
    ]
    children = [child for child, parent in enumerate(rig.parents) if parent == joint]
    for child in children:
        _write_joint(rig, child, depth + 1, channels, lines, order)
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
