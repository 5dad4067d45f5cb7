"""Names, dtypes and shapes of the arrays in ``reconstruction.npz``, and conversion of a reconstruction to arrays.

Lengths are in metres. The frame is the OpenCV camera's (x right, y down, z forward). Pixel (0, 0) is the centre of the
top left pixel. H and W are image rows and columns, F faces, V vertices, J keypoints, K shape components, E expression
components, M floor points. Person ``i`` counts from 0.
"""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types import BodyParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Person, Reconstruction

    AnyArray = NDArray[Any]

__all__ = ["PERSON_ARRAYS", "SHARED_ARRAYS", "ArraySpec", "npz_checksum", "to_arrays"]


@dataclass(frozen=True)
class ArraySpec:
    """Name, dtype, shape and meaning of one array in the file.

    Attributes:
        name: key in the file; names of a person's arrays start with ``person_{i}_``.
        dtype: as stored; "floating" for float32 or float64 as the backend returned it, "text" for a unicode string.
        shape: sizes, with the letters of this module's docstring.
        meaning: unit, frame and content.
    """

    name: str
    dtype: str
    shape: tuple[str | int, ...]
    meaning: str


SHARED_ARRAYS: tuple[ArraySpec, ...] = (
    ArraySpec("image", "uint8", ("H", "W", 3), "photo, RGB, upright, as reconstructed"),
    ArraySpec("intrinsics", "float64", (3, 3), "camera matrix of `image`, px"),
    ArraySpec("scene_points", "float32", ("H", "W", 3), "scene without people, m, camera frame"),
    ArraySpec("scene_normals", "float32", ("H", "W", 3), "unit, camera frame, facing the camera; 0 where unreliable"),
    ArraySpec("scene_colors", "uint8", ("H", "W", 3), "RGB of the photo without people"),
    ArraySpec("scene_valid", "bool", ("H", "W"), "which pixels of the scene arrays are valid"),
    ArraySpec(
        "floor_points", "float32", ("M", 3), "sampled on the floor plane, m, camera frame; M = 0 without a floor"
    ),
    ArraySpec("floor_normal", "floating", ("P", 3), "unit, up, camera frame; P = 1, or 0 where no floor was found"),
    ArraySpec("faces", "int32", ("F", 3), "vertex ids of every person's triangles, counter-clockwise from outside"),
    ArraySpec("body_model", "text", (), "name of the body model that the parameters are for"),
    ArraySpec("skeleton", "text", (), "name of the skeleton of the keypoints"),
)
"""Specifications of the arrays that exist once per file."""

PERSON_ARRAYS: tuple[ArraySpec, ...] = (
    ArraySpec("box", "floating", (4,), "x0 y0 x1 y1, px, half open"),
    ArraySpec("mask", "bool", ("H", "W"), "visible pixels"),
    ArraySpec("keypoints", "floating", ("J", 2), "px"),
    ArraySpec("keypoint_confidence", "floating", ("J",), "0 to 1"),
    ArraySpec("global_orient", "float32", (1, 3), "rotation vector about the pelvis joint, rad"),
    ArraySpec("body_pose", "float32", (1, 63), "joints 1-21 of SMPL-X, rotation vectors, rad"),
    ArraySpec("left_hand_pose", "float32", (1, 45), "index, middle, pinky, ring, thumb; rad, from a flat hand"),
    ArraySpec("right_hand_pose", "float32", (1, 45), "the same of the right hand"),
    ArraySpec("jaw_pose", "float32", (1, 3), "rad"),
    ArraySpec("leye_pose", "float32", (1, 3), "rad"),
    ArraySpec("reye_pose", "float32", (1, 3), "rad"),
    ArraySpec("betas", "float32", (1, "K"), "shape, unit variance, for `body_model` only"),
    ArraySpec("expression", "float32", (1, "E"), "expression, for `body_model` only"),
    ArraySpec("transl", "float32", (1, 3), "m, added after posing"),
    ArraySpec("vertices", "float32", ("V", 3), "m, camera frame"),
    ArraySpec("joints", "float32", (55, 3), "m, camera frame, SMPL-X order"),
    ArraySpec("contact", "bool", ("V",), "whether the vertex touches the scene or the floor"),
    ArraySpec(
        "distance", "float32", ("V",), "signed distance to the scene or floor, m: < 0 inside, inf if none is near"
    ),
)
"""Specifications of the arrays of each person, stored as ``person_0_box``, ``person_1_box``, ..."""

PARAMETER_NAMES = tuple(field.name for field in fields(BodyParameters))

_STORED_AS_IS = ("float32", "float64")


def to_arrays(reconstruction: Reconstruction) -> dict[str, AnyArray]:
    """Convert a reconstruction to arrays, with the names, dtypes and shapes that this module documents."""
    scene = reconstruction.scene
    floor = np.empty((0, 3)) if scene.floor is None else np.asarray(scene.floor.normal)[None]
    values: dict[str, Any] = {
        "image": reconstruction.image,
        "intrinsics": reconstruction.intrinsics.matrix,
        "scene_points": scene.points,
        "scene_normals": scene.normals,
        "scene_colors": scene.colors,
        "scene_valid": scene.valid,
        "floor_points": scene.floor_points,
        "floor_normal": floor,
        "faces": reconstruction.faces,
        "body_model": reconstruction.body_model,
        "skeleton": getattr(reconstruction.skeleton, "name", reconstruction.skeleton),
    }
    arrays = {spec.name: _stored(values[spec.name], spec) for spec in SHARED_ARRAYS}
    for index, person in enumerate(reconstruction.people):
        arrays.update({f"person_{index}_{spec.name}": _stored(_value(person, spec), spec) for spec in PERSON_ARRAYS})
    return arrays


def npz_checksum(path: Path) -> str:
    """Compute a checksum of an npz file from the names and CRC-32s of its arrays."""
    with zipfile.ZipFile(path) as archive:
        content = "".join(f"{entry.filename} {entry.CRC:08x}\n" for entry in archive.infolist())
    return f"{zlib.crc32(content.encode()):08x}"


def _value(person: Person, spec: ArraySpec) -> Any:
    return getattr(person.parameters if spec.name in PARAMETER_NAMES else person, spec.name)


def _stored(value: Any, spec: ArraySpec) -> AnyArray:
    if spec.dtype == "text":
        return np.array(str(value))
    if spec.dtype == "floating":
        array = np.ascontiguousarray(value)
        return array if array.dtype.name in _STORED_AS_IS else array.astype(np.float64)
    return np.ascontiguousarray(value, dtype=spec.dtype)
