"""What an exporter gets, and the frame that it writes in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.geometry.upright import gltf_from_camera

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from physic_core.types import Person, Plane, Reconstruction

_Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class ExportFrame:
    """Frame of an exported file, in metres.

    Attributes:
        up: "y", "z" or "camera".
        from_camera: (4, 4) rigid transform from the camera frame (x right, y down, z forward).
        axes: description of the axes and the origin.
        notes: sentences for the user.
    """

    up: str
    from_camera: NDArray[np.float64]
    axes: str
    notes: tuple[str, ...] = ()

    @property
    def up_vector(self) -> NDArray[np.float64]:
        """Unit vector (3,) that points up in this frame; of a camera frame, the camera's up."""
        return np.array({"y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0], "camera": [0.0, -1.0, 0.0]}[self.up])


@dataclass(frozen=True)
class ExportRequest:
    """One export.

    Attributes:
        result: the reconstruction.
        people: indices of the people to write; each has a finite body.
        frame: of the file.
        stem: file name without suffix.
        suffix: of the file, with its dot.
        scene: whether to write the scene too.
        body_file: SMPL-X file of the user, or None.
        options: name -> value of the ``options`` of the record; their defaults where the user gave none.
    """

    result: Reconstruction
    people: tuple[int, ...]
    frame: ExportFrame
    stem: str
    suffix: str
    scene: bool = True
    body_file: Path | None = None
    options: Mapping[str, str | bool] = field(default_factory=dict)

    def chosen(self) -> list[tuple[int, Person]]:
        """Return index and person of the people to write."""
        return [(index, self.result.people[index]) for index in self.people]

    def file_of(self, person: int) -> str:
        """Return the name of the file of one person: the stem, with the person's number if there are several."""
        return f"{self.stem}{self.suffix}" if len(self.people) == 1 else f"{self.stem}_{person}{self.suffix}"


def export_frame(floor: Plane | None, up: str) -> ExportFrame:
    """Return the frame with an up axis.

    "y" and "z" have the origin on the floor below the camera, and the camera looks along -z or +y. "camera" is the
    frame of the result. Without a floor, "y" has its origin in the camera, and y is the camera's up axis.

    Raises:
        InputError: z up without a floor.
    """
    if up == "camera":
        return ExportFrame(up, np.eye(4), "x right, y down, z forward, origin at the camera")
    matrix = gltf_from_camera(floor)
    origin = "origin on the floor below the camera"
    if up == "z":
        if floor is None:
            raise InputError(
                "z up needs the direction of gravity, which is the normal of the floor, and this result has no floor: "
                "use a format with --up y (y is then the camera's up axis) or --up camera"
            )
        return ExportFrame(up, _Z_UP_FROM_Y_UP @ matrix, f"x right, y forward, z up, {origin}")
    if floor is None:
        note = "the result has no floor: y is the camera's up axis, and the origin is the camera"
        return ExportFrame(up, matrix, "x right, y up (of the camera), z backward, origin at the camera", (note,))
    return ExportFrame(up, matrix, f"x right, y up, z backward, {origin}")


def camera_pose(frame: ExportFrame) -> NDArray[np.float64]:
    """Return the pose (4, 4) of a camera that looks along its -z with y up, as in glTF, USD and MuJoCo."""
    return frame.from_camera @ np.diag([1.0, -1.0, -1.0, 1.0])
