"""What a data set gives, and what a method gives: frames with truth, and predictions.

Lengths are metres and pixels. A camera frame is OpenCV's: x right, y down, z forward.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_bench.cameras import Camera
    from physic_core.types import AnyArray


TOPOLOGY_OF_COUNT: Mapping[int, str] = {
    6890: "smpl",
    10475: "smplx",
    13348: "physic-embedded-1",
    18439: "mhr",
}
"""Number of vertices -> name of the mesh topology."""


@dataclass(frozen=True)
class Picture:
    """A photo as it lies on the disk.

    Attributes:
        path: of the file.
        mirrored: whether the file is the mirror image of what the camera saw.
    """

    path: Path
    mirrored: bool = False


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh.

    Attributes:
        vertices: (V, 3) m.
        faces: (F, 3) int64, counter-clockwise seen from outside.
    """

    vertices: AnyArray
    faces: AnyArray


@dataclass(frozen=True, eq=False)
class BenchPerson:
    """A person of a data set or of a result, OpenCV camera frame, metres; None is unknown.

    Attributes:
        name: unique in the frame.
        joints: (J, 3), NaN where unknown.
        joint_names: J names as in SMPL-X ("left_knee").
        joint_source: where true joints come from, for the table.
        vertices: (V, 3).
        topology: name of the mesh ("smplx", "smpl"); "" without vertices.
        contact: (V,) bool.
        contact_topology: name of the mesh of ``contact``.
        marks: probabilities of a result that pose, place, contact and size are right.
    """

    name: str = "0"
    joints: AnyArray | None = None
    joint_names: tuple[str, ...] = ()
    joint_source: str = ""
    vertices: AnyArray | None = None
    topology: str = ""
    contact: AnyArray | None = None
    contact_topology: str = ""
    marks: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of one frame.

    Attributes:
        people: everybody who is annotated.
        scene: mesh of the scene in the world frame of the frame's camera, or a function that
            returns the signed distance (N,) m of points (N, 3) of the camera frame; or None.
        up: (3,) unit, camera frame, or None.
        camera_height: metres of the camera over the floor; NaN if unknown.
    """

    people: tuple[BenchPerson, ...] = ()
    scene: Surface | Callable[[AnyArray], AnyArray] | None = None
    up: AnyArray | None = None
    camera_height: float = float("nan")


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a data set.

    Attributes:
        id: unique in the data set, fit for a file path ("vicon_03301_01/s001_frame_00001").
        sequence: pictures of one sequence are not independent.
        camera: intrinsics with distortion, and the transform from the world.
        picture: the file, or None.
        truth: reads the ground truth.
        group: pictures of one moment from several cameras share it; "" without such.
    """

    id: str
    sequence: str
    truth: Callable[[], Truth]
    camera: Camera
    picture: Picture | None = None
    group: str = ""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A method's result for one frame.

    Attributes:
        people: best first.
        K: (3, 3) px that the method assumed, of the picture of the frame's camera; None if it
            states none.
        floor: (4,) normal and offset of the floor's plane, camera frame, or None.
    """

    people: tuple[BenchPerson, ...]
    K: AnyArray | None = None
    floor: AnyArray | None = None
