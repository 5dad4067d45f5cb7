"""Results of HSfM: people, cameras and point maps in one world, per picture set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_evaluate.contract import PredictedPerson, Prediction
from physic_evaluate.damage import DamagedFileError, number_array, require_finite, require_rotation, table
from physic_evaluate.pickled import pickled_arrays
from physic_evaluate.readers.base import ResultReader, first_file, person_of_body

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_evaluate.contract import Frame

    Array = NDArray[np.float64]

__all__ = ["READER", "Hsfm"]

CAMERAS, PEOPLE = "hsfm_places_cameras", "hsfm_people(smplx_params)"


class Hsfm(ResultReader):
    """Reads people and points, and moves them from HSfM's world into the camera of the picture.

    HSfM places a body by its pelvis: ``root_transl`` is the place of joint 0, not SMPL-X's translation.
    """

    name: ClassVar[str] = "hsfm"
    summary: ClassVar[str] = "HSfM: hsfm_output_smplx.pkl or hsfm_output_smpl.pkl"
    layout: ClassVar[str] = "FRAME/hsfm_output_smplx.pkl or SEQUENCE/...; the camera is that of the picture's name"

    def locate(self, frame: Frame) -> Path | None:
        """Return the pickle of the frame or of its sequence."""
        kinds = ("smplx", "smpl")
        patterns = [f"{place}/hsfm_output_{kind}.pkl" for place in ("{name}", "{sequence}") for kind in kinds]
        return first_file(self.folder, frame, *patterns, *(f"hsfm_output_{kind}_{{name}}.pkl" for kind in kinds))

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Pose the bodies by the user's model file."""
        values = pickled_arrays(path)
        camera = _camera(table(values, CAMERAS, path), frame, path)
        to_world = require_finite(number_array(camera, "cam2world", path, (4, 4)), f"{path}: 'cam2world'")
        require_rotation(to_world[:3, :3], f"{path}: the rotation of 'cam2world'")
        to_camera: Array = np.asarray(np.linalg.inv(to_world), np.float64)
        everybody = table(values, PEOPLE, path)
        people = tuple(self._person(table(everybody, name, path), to_camera, path) for name in everybody)
        points = None
        if "pts3d" in camera:
            points = _moved(to_camera, number_array(camera, "pts3d", path, (-1, 3)))
        return Prediction(people, K=_resized(camera, path, frame), scene_points=points)

    def _person(self, values: dict[str, Any], to_camera: Array, path: Path) -> PredictedPerson:
        place = number_array(values, "root_transl", path, (3,))
        names = ("body_pose", "global_orient", *(n for n in values if n == "betas" or "pose" in str(n)))
        own = {name: number_array(values, name, path).reshape(-1) for name in names} | {"transl": np.zeros(3)}
        smpl = own["body_pose"].size in (69, 207)
        body = (self.bodies.smpl_body if smpl else self.bodies.smplx_body)(own)
        person = person_of_body(body, moved=place - body.joints[0])
        return PredictedPerson(
            vertices=_moved(to_camera, np.asarray(person.vertices)),
            topology=person.topology,
            joints=_moved(to_camera, np.asarray(person.joints)),
            joint_names=person.joint_names,
        )


def _camera(cameras: dict[Any, Any], frame: Frame, path: Path) -> dict[str, Any]:
    """Return the camera of the picture: that of its name, or the only one."""
    stem = frame.id.rpartition("/")[2] if frame.picture is None else frame.picture.path.stem
    for name in cameras:
        if stem in (str(name), Path(str(name)).stem):
            return table(cameras, name, path)
    if len(cameras) == 1:
        return table(cameras, next(iter(cameras)), path)
    raise DamagedFileError(f"{path} has no camera '{stem}': it has {', '.join(map(str, cameras))}")


def _resized(camera: dict[str, Any], path: Path, frame: Frame) -> Array | None:
    """Return K in px of the frame's picture: HSfM works on a smaller one."""
    if "intrinsic" not in camera:
        return None
    K: Array = number_array(camera, "intrinsic", path, (3, 3))
    if frame.camera is None or "rgbimg" not in camera:
        return K
    picture = number_array(camera, "rgbimg", path)
    if picture.ndim < 2 or not picture.size:
        raise DamagedFileError(f"{path}: 'rgbimg' must have the shape (height, width, 3), got {picture.shape}")
    height, width = picture.shape[:2]
    factor = np.array([frame.camera.width / width, frame.camera.height / height])
    K = K.copy()
    K[:2, :2] *= factor[:, None]
    K[:2, 2] = (K[:2, 2] + 0.5) * factor - 0.5
    return K


def _moved(matrix: Array, points: Array) -> Array:
    moved: Array = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


READER = Hsfm
