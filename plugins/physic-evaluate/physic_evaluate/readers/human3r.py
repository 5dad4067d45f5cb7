"""Results of Human3R: folders smpl, camera and depth of its demo with --save."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physic_core.body.joints import JOINT_NAMES
from physic_evaluate.contract import PredictedPerson, Prediction
from physic_evaluate.damage import DamagedFileError, number_array
from physic_evaluate.readers.base import ResultReader, archive_arrays, first_file, person_of_body

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_evaluate.contract import Frame

    Array = NDArray[np.float64]

__all__ = ["READER", "Human3r"]

HEAD = JOINT_NAMES.index("head")
HANDS = slice(22, 37), slice(37, 52)
"""Rows of its 53 rotations: root and body (22), left hand, right hand, jaw."""


class Human3r(ResultReader):
    """Reads smpl/NUMBER.npz and camera/NUMBER.npz.

    Human3R places a body by its head: ``transl`` is the place of the head joint in the camera frame.
    """

    name: ClassVar[str] = "human3r"
    summary: ClassVar[str] = "Human3R: smpl/, camera/ and depth/ of its demo"
    layout: ClassVar[str] = "SEQUENCE/smpl/NUMBER.npz and SEQUENCE/camera/NUMBER.npz, by the last number in FRAME"

    def locate(self, frame: Frame) -> Path | None:
        """Return the file of the people."""
        numbers = re.findall(r"\d+", frame.id.rpartition("/")[2].partition("__")[0])
        found = first_file(
            self.folder, frame, "smpl/{name}.npz", "{sequence}/smpl/{name}.npz", "{name}/smpl/000000.npz"
        )
        if found is not None or not numbers:
            return found
        name = f"{int(numbers[-1]):06d}.npz"
        for folder in (self.folder / frame.sequence, self.folder):
            if (folder / "smpl" / name).is_file():
                return folder / "smpl" / name
        return None

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Pose the bodies by the user's SMPL-X file."""
        arrays = archive_arrays(path)
        people: tuple[PredictedPerson, ...] = ()
        if any(number_array(arrays, name, path).size for name in ("transl", "shape", "rotvec")):
            places = number_array(arrays, "transl", path, (-1, 3))
            shapes = number_array(arrays, "shape", path, (len(places), -1))
            rotvecs = number_array(arrays, "rotvec", path, (len(places), 53, 3))
            people = tuple(self._person(*rows) for rows in zip(rotvecs, shapes, places, strict=True))
        return Prediction(people, K=_intrinsics(path, frame), scene_points=None)

    def _person(self, rotvecs: Array, shape: Array, place: Array) -> PredictedPerson:
        body = self.bodies.smplx_body(
            {
                "global_orient": rotvecs[0],
                "body_pose": rotvecs[1:22],
                "left_hand_pose": rotvecs[HANDS[0]],
                "right_hand_pose": rotvecs[HANDS[1]],
                "jaw_pose": rotvecs[52],
                "betas": shape,
            }
        )
        return person_of_body(body, moved=place - body.joints[HEAD])


def _intrinsics(path: Path, frame: Frame) -> Array | None:
    """Return K in px of the frame's picture; the file's is for Human3R's smaller picture, whose middle is known."""
    file = path.parent.parent / "camera" / path.name
    if not file.is_file() or frame.camera is None:
        return None
    K: Array = number_array(archive_arrays(file), "intrinsics", file, (3, 3)).copy()
    if not (K[:2, 2] > 0).all():
        raise DamagedFileError(f"{file}: the principal point of 'intrinsics' is {K[:2, 2].tolist()}, not in a picture")
    # Its principal point is the middle of the picture it worked on, so that the size is twice that.
    factor = np.array([frame.camera.width, frame.camera.height]) / (2 * K[:2, 2])
    K[:2] *= factor[:, None]
    return K


READER = Human3r
