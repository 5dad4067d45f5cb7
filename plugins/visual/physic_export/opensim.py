"""OpenSim: joints as markers (TRC), and the pose as coordinates of its Rajagopal model (MOT)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.body import JOINT_NAMES, segment_axes
from physic_core.geometry import rotmat_to_euler, rotvec_to_rotmat_numpy, transform_points

if TYPE_CHECKING:
    from physic_core.export import ExportFrame
    from physic_core.types import Person

_MARKERS = JOINT_NAMES[:22]
_MM = 1000.0
_TRC_HEADER = (
    *("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"),
    *("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"),
)

_PELVIS_FROM_HIPS_M = np.array([0.056276, 0.07849, 0.0])
"""From the middle of the hips to the origin of the pelvis in the unscaled model, its axes x
forward, y up, z right.

Source: the hip joints of A. Rajagopal et al., IEEE Trans. Biomed. Eng. 63.10 (2016).
"""

_TRUNK = {
    "lumbar_extension": ("trunk_flexion", -1),
    "lumbar_bending": ("trunk_bending", 1),
    "lumbar_rotation": ("trunk_rotation", 1),
}
_LIMBS = {
    "hip_flexion": ("hip_flexion", 1),
    "hip_adduction": ("hip_abduction", -1),
    "hip_rotation": ("hip_rotation", 1),
    "knee_angle": ("knee_flexion", 1),
    "ankle_angle": ("ankle_dorsiflexion", 1),
    "subtalar_angle": ("ankle_eversion", -1),
    "arm_flex": ("shoulder_flexion", 1),
    "arm_add": ("shoulder_abduction", -1),
    "arm_rot": ("shoulder_rotation", 1),
    "elbow_flex": ("elbow_flexion", 1),
}
"""Coordinate of the model -> angle of ``Person.joint_angles``, and the sign."""


def export_trc(request: ExportRequest) -> ExportedFiles:
    """Return one TRC file per person: a frame with 22 joints as markers, millimetres."""
    files = {}
    for index, person in request.chosen():
        name = request.file_of(index)
        points = _MM * transform_points(request.frame.from_camera, person.joints[:22])
        axes = (f"{axis}{number + 1}" for number in range(22) for axis in "XYZ")
        lines = (
            ("PathFileType", "4", "(X/Y/Z)", name),
            _TRC_HEADER,
            ("30", "30", "1", "22", "mm", "30", "1", "1"),
            ("Frame#", "Time", *(f"{marker}\t\t" for marker in _MARKERS)),
            ("", "", *axes),
            ("",),
            ("1", "0.0", *(f"{value:.3f}" for value in points.reshape(-1))),
        )
        files[name] = _tab_separated(lines)
    return ExportedFiles(files, ("lengths are millimeters, y is up",))


def export_mot(request: ExportRequest) -> ExportedFiles:
    """Return one MOT file per person: a frame of coordinates of the Rajagopal model, degrees and
    metres.
    """
    files = {}
    for index, person in request.chosen():
        name = request.file_of(index)
        values = {"time": 0.0, **_coordinates(person, request.frame)}
        files[name] = _tab_separated(
            (
                (name,),
                ("version=1",),
                ("nRows=1",),
                (f"nColumns={len(values)}",),
                ("inDegrees=yes",),
                ("endheader",),
                tuple(values),
                tuple(f"{value:.6f}" for value in values.values()),
            )
        )
    return ExportedFiles(
        files,
        (
            "lower arms' pronation, wrists and toes are left out: the model keeps its defaults",
            "the place of the pelvis is that of the unscaled model about the hips",
        ),
    )


def _coordinates(person: Person, frame: ExportFrame) -> dict[str, float]:
    """Return coordinate -> value; the frame has y up."""
    turn = rotvec_to_rotmat_numpy(person.parameters.global_orient[0].astype(np.float64))
    pelvis = segment_axes(frame.from_camera[:3, :3] @ turn)
    hips = transform_points(frame.from_camera, person.joints[1:3]).mean(0)
    turns = np.degrees(rotmat_to_euler("ZXY", pelvis))
    pelvis_position = hips + pelvis @ _PELVIS_FROM_HIPS_M
    angles = person.joint_angles
    sides = {"r": "right", "l": "left"}
    return (
        dict(zip(("pelvis_tilt", "pelvis_list", "pelvis_rotation"), turns.tolist(), strict=True))
        | dict(zip(("pelvis_tx", "pelvis_ty", "pelvis_tz"), pelvis_position.tolist(), strict=True))
        | {name: sign * angles[angle] for name, (angle, sign) in _TRUNK.items()}
        | {
            f"{name}_{letter}": sign * angles[f"{side}_{angle}"]
            for letter, side in sides.items()
            for name, (angle, sign) in _LIMBS.items()
        }
    )


def _tab_separated(lines: tuple[tuple[str, ...], ...]) -> bytes:
    return "".join("\t".join(line) + "\n" for line in lines).encode()
