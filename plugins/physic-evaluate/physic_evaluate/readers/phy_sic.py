"""Results of the published code and its forks: scene_data_final.pkl of each photo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physic_evaluate.contract import Prediction
from physic_evaluate.damage import DamagedFileError, finite_number, item, number_array, require_finite, table
from physic_evaluate.pickled import pickled_arrays
from physic_evaluate.readers.base import ResultReader, first_file
from physic_evaluate.readers.physic_release import people_of_release

if TYPE_CHECKING:
    from physic_evaluate.contract import Frame

__all__ = ["READER", "PhySic"]


class PhySic(ResultReader):
    """Reads bodies, K, scene points and their normals."""

    name: ClassVar[str] = "phy-sic"
    summary: ClassVar[str] = "scene_data_final.pkl of the published code (Phy-SIC) and its forks"
    layout: ClassVar[str] = "FRAME/scene_data_final.pkl"

    def locate(self, frame: Frame) -> Path | None:
        """Return the file of the frame."""
        return first_file(self.folder, frame, "{name}/scene_data_final.pkl")

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Pose the bodies by the user's SMPL-X file."""
        values = pickled_arrays(path)
        scale = finite_number(values, "scale", path) if "scale" in values else 1.0
        points = scale * number_array(values, "pts3d", path, (-1, 3))
        normals = number_array(values, "normals", path)
        if "inlier_mask" in values and normals.ndim == 3:
            normals = normals[number_array(values, "inlier_mask", path, normals.shape[:2]) > 0]
        if "plane_points" in values and values["plane_points"] is not None:
            floor = scale * number_array(values, "plane_points", path, (-1, 3))
            points = np.concatenate([points, floor])
            up = require_finite(number_array(values, "plane_normal", path).reshape(-1)[:3], f"{path}: 'plane_normal'")
            if len(up) != 3:
                raise DamagedFileError(f"{path}: 'plane_normal' must be 3 numbers or more, got {len(up)}")
            normals = np.concatenate([normals.reshape(-1), np.tile(up, len(floor))])
        if normals.size != points.size:
            raise DamagedFileError(
                f"{path}: 'normals' has {normals.size} numbers with those of the floor, and the points {points.size}"
            )
        arrays = {f"final_{name}": value for name, value in table(values, "body_params", path).items()}
        arrays |= {"final_cam_trans": item(values, "cam_trans", path), "scene_points": points}
        arrays["scene_normals"] = normals.reshape(-1, 3)
        people = people_of_release(arrays, "final", path, self.bodies)
        return Prediction(people, K=number_array(values, "K", path, (3, 3)), scene_points=points)


READER = PhySic
