"""Results of SAM 3D Body: the fields that its estimator returns, saved as npz, one file per person or picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_evaluate.contract import PredictedPerson, Prediction
from physic_evaluate.damage import number_array
from physic_evaluate.meshes import require_metres
from physic_evaluate.readers.base import ResultReader, archive_arrays, file_names

if TYPE_CHECKING:
    from physic_evaluate.contract import Frame

__all__ = ["READER", "Sam3dBody"]

LIMBS = {
    "left_shoulder": 5,
    "right_shoulder": 6,
    "left_elbow": 7,
    "right_elbow": 8,
    "left_hip": 9,
    "right_hip": 10,
    "left_knee": 11,
    "right_knee": 12,
    "left_ankle": 13,
    "right_ankle": 14,
    "right_wrist": 41,
    "left_wrist": 62,
}
"""Rows of its 70 keypoints, in the order of MHR-70."""


class Sam3dBody(ResultReader):
    """Reads ``pred_vertices`` (18439, 3), ``pred_cam_t`` (3,), ``focal_length`` and ``pred_keypoints_3d`` (70, 3)."""

    name: ClassVar[str] = "sam-3d-body"
    summary: ClassVar[str] = "SAM 3D Body: its estimator's fields as npz; MHR meshes and 12 joints"
    layout: ClassVar[str] = "FRAME.npz, FRAME_0.npz, FRAME_1.npz ..., or FRAME/*.npz"

    def locate(self, frame: Frame) -> Path | None:
        """Return the first file of the frame."""
        found = self._files(frame)
        return found[0] if found else None

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Read all people of the picture."""
        people: list[PredictedPerson] = []
        K = None
        for file in self._files(frame) or [path]:
            arrays = archive_arrays(file)
            people += _people(arrays, file)
            if "focal_length" in arrays and frame.camera is not None:
                focal = float(number_array(arrays, "focal_length", file, (-1,))[0])
                # Its camera has the principal point in the middle of the picture.
                K = np.array([[focal, 0, frame.camera.width / 2], [0, focal, frame.camera.height / 2], [0, 0, 1.0]])
        return Prediction(tuple(people), K=K)

    def _files(self, frame: Frame) -> list[Path]:
        for name in file_names(frame):
            if (self.folder / f"{name}.npz").is_file():
                return [self.folder / f"{name}.npz"]
            found = sorted(self.folder.glob(f"{name}_[0-9]*.npz")) or sorted(self.folder.glob(f"{name}/*.npz"))
            if found:
                return found
        return []


def _people(arrays: Mapping[str, Any], path: Path) -> list[PredictedPerson]:
    moves = number_array(arrays, "pred_cam_t", path, (-1, 3))
    vertices = number_array(arrays, "pred_vertices", path, (len(moves), -1, 3))
    keypoints = None
    if "pred_keypoints_3d" in arrays:
        keypoints = number_array(arrays, "pred_keypoints_3d", path, (len(moves), -1, 3))
    people = []
    for row, move in enumerate(moves):
        require_metres(vertices[row], path)
        known = keypoints is not None and keypoints.shape[1] > max(LIMBS.values())
        people.append(
            PredictedPerson(
                vertices=vertices[row] + move,
                topology="mhr",
                joints=keypoints[row, list(LIMBS.values())] + move if keypoints is not None and known else None,
                joint_names=tuple(LIMBS) if known else (),
            )
        )
    return people


READER = Sam3dBody
