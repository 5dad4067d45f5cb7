"""The body model: linear blend skinning of the embedded body or of a user's SMPL-X file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.body.joints import (
    FINGER_JOINTS,
    JOINT_INDEX,
    JOINT_NAMES,
    MAX_FLEXION,
    NUM_JOINTS,
    PARENTS,
    PART_NAMES,
    ROTATION_FIELDS,
    joint_pair,
)
from physic_core.lazy import importer

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.body.array_pickle import InvalidArrayError as InvalidArrayError
    from physic_core.body.array_pickle import PickledObject as PickledObject
    from physic_core.body.array_pickle import UnsafePickleError as UnsafePickleError
    from physic_core.body.array_pickle import as_array as as_array
    from physic_core.body.array_pickle import read_pickle as read_pickle
    from physic_core.body.array_pickle import read_plain as read_plain
    from physic_core.body.arrays import BodyArrays as BodyArrays
    from physic_core.body.bones import ANCESTOR_MATRIX as ANCESTOR_MATRIX
    from physic_core.body.bones import BoneOffsets as BoneOffsets
    from physic_core.body.bones import cholesky_solve as cholesky_solve
    from physic_core.body.bones import fit_shape as fit_shape
    from physic_core.body.bones import head_direction as head_direction
    from physic_core.body.bones import matmul as matmul
    from physic_core.body.bones import parameters_from_rotations as parameters_from_rotations
    from physic_core.body.bones import pose_from_parameters as pose_from_parameters
    from physic_core.body.bones import rotations_from_parameters as rotations_from_parameters
    from physic_core.body.bones import rotations_from_parents as rotations_from_parents
    from physic_core.body.bones import rotations_from_tpose as rotations_from_tpose
    from physic_core.body.files import MANO as MANO
    from physic_core.body.files import SMPL as SMPL
    from physic_core.body.files import SMPL_PARENTS as SMPL_PARENTS
    from physic_core.body.files import ModelFileLayout as ModelFileLayout
    from physic_core.body.files import SmplBody as SmplBody
    from physic_core.body.files import embedded_arrays as embedded_arrays
    from physic_core.body.files import load_smpl as load_smpl
    from physic_core.body.files import read_model_file as read_model_file
    from physic_core.body.files import smplx_arrays as smplx_arrays
    from physic_core.body.joint_angles import segment_axes as segment_axes
    from physic_core.body.landmarks import BODY_POINTS as BODY_POINTS
    from physic_core.body.landmarks import keypoints_on_body as keypoints_on_body
    from physic_core.body.model import BodyModel as BodyModel
    from physic_core.body.model import BodyOutput as BodyOutput
    from physic_core.body.model import LandmarkModel as LandmarkModel
    from physic_core.body.model import build_body_model as build_body_model
    from physic_core.body.model import rest_mesh_of_model as rest_mesh_of_model
    from physic_core.body.posing import JointTree as JointTree
    from physic_core.body.posing import Skin as Skin
    from physic_core.body.posing import parent_rotations as parent_rotations
    from physic_core.body.posture import angle_deg as angle_deg
    from physic_core.body.posture import legs_in_line as legs_in_line
    from physic_core.body.posture import standing_legs as standing_legs

__all__ = [
    "FINGER_JOINTS",
    "JOINT_INDEX",
    "JOINT_NAMES",
    "MAX_FLEXION",
    "NUM_JOINTS",
    "PARENTS",
    "PART_NAMES",
    "ROTATION_FIELDS",
    "joint_pair",
    "load_body",
]

_NAMES = {
    "array_pickle": "InvalidArrayError PickledObject UnsafePickleError as_array read_pickle "
    "read_plain",
    "arrays": "BodyArrays",
    "bones": "ANCESTOR_MATRIX BoneOffsets cholesky_solve fit_shape head_direction "
    "matmul parameters_from_rotations pose_from_parameters "
    "rotations_from_parameters rotations_from_parents rotations_from_tpose",
    "files": "MANO ModelFileLayout SMPL SMPL_PARENTS SmplBody embedded_arrays load_smpl "
    "read_model_file smplx_arrays",
    "joint_angles": "segment_axes",
    "landmarks": "BODY_POINTS keypoints_on_body",
    "model": "BodyModel BodyOutput LandmarkModel build_body_model rest_mesh_of_model",
    "posing": "JointTree Skin parent_rotations",
    "posture": "angle_deg legs_in_line standing_legs",
}

__getattr__ = importer(__name__, _NAMES)


def load_body(source: str | Path = "embedded") -> BodyModel:
    """Load the embedded body model or a SMPL-X file.

    Args:
        source: "embedded", or the path of your own ``SMPLX_*.npz`` (layouts v1.0 and v1.1; its
            first 10 shape and 10 expression components are used,
            ``physic_core.body.files.load_smplx`` takes other numbers).

    Raises:
        BodyModelError: the file does not exist, or is not an SMPL-X model.
    """
    from physic_core.body.files import load_embedded, load_smplx

    return load_embedded() if source == "embedded" else load_smplx(source)
