"""Names, dtypes and shapes of the arrays in ``reconstruction.npz``, and conversion of a reconstruction to arrays.

Lengths are in metres. The frame is the OpenCV camera's (x right, y down, z forward). Pixel (0, 0) is the centre of the
top left pixel. H and W are image rows and columns, F faces, V vertices, J keypoints, K shape components, E expression
components, M floor points, P is 1 with a floor and 0 without one. Person ``i`` counts from 0.

A new array is one line in a table here, a field of the dataclass that its ``attribute`` names, and one row of
docs/file-format.md. Saving, loading, the smaller form and all checks read the tables.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.files.npz import ArrayHeader
    from physic_core.types import Reconstruction

    AnyArray = NDArray[Any]


@dataclass(frozen=True)
class ArraySpec:
    """Name, dtype, shape and meaning of one array in the file.

    Attributes:
        name: key in the file; names of a person's arrays start with ``person_{i}_``.
        dtype: as stored; "floating" for float32 or float64 as the backend returned it, "text" for a unicode string.
        shape: sizes, with the letters of this module's docstring.
        meaning: unit, frame and content.
        attribute: of the reconstruction or the person, such as "scene.points"; "" for one that is converted.
        optional: whether the attribute may be None; the array is then not in the file.
        compact: how the smaller form stores it: "exact", "float16", or "grid" (rounded to 1/16384 m).
    """

    name: str
    dtype: str
    shape: tuple[str | int, ...]
    meaning: str
    attribute: str = ""
    optional: bool = False
    compact: str = "exact"


SHARED_ARRAYS: tuple[ArraySpec, ...] = (
    ArraySpec("image", "uint8", ("H", "W", 3), "photo, RGB, upright, as reconstructed", "image"),
    ArraySpec("intrinsics", "float64", (3, 3), "camera matrix of `image`, px"),
    ArraySpec("scene_points", "float32", ("H", "W", 3), "scene without people, m, camera frame", "scene.points"),
    ArraySpec(
        "scene_normals",
        "float32",
        ("H", "W", 3),
        "unit, camera frame, facing the camera; 0 where unreliable",
        "scene.normals",
    ),
    ArraySpec("scene_colors", "uint8", ("H", "W", 3), "RGB of the photo without people", "scene.colors"),
    ArraySpec("scene_valid", "bool", ("H", "W"), "which pixels of the scene arrays are valid", "scene.valid"),
    ArraySpec(
        "floor_points",
        "float32",
        ("M", 3),
        "sampled on the floor plane, m, camera frame; M = 0 without a floor",
        "scene.floor_points",
        compact="grid",
    ),
    ArraySpec("floor_normal", "floating", ("P", 3), "unit, up, camera frame; P = 1, or 0 where no floor was found"),
    ArraySpec(
        "faces", "int32", ("F", 3), "vertex ids of every person's triangles, counter-clockwise from outside", "faces"
    ),
    ArraySpec("body_model", "text", (), "name of the body model that the parameters are for"),
    ArraySpec("skeleton", "text", (), "name of the skeleton of the keypoints"),
)
"""Specifications of the arrays that exist once per file."""

PERSON_ARRAYS: tuple[ArraySpec, ...] = (
    ArraySpec("box", "floating", (4,), "x0 y0 x1 y1, px, half open", "box"),
    ArraySpec("mask", "bool", ("H", "W"), "visible pixels", "mask"),
    ArraySpec("keypoints", "floating", ("J", 2), "px", "keypoints"),
    ArraySpec("keypoint_confidence", "floating", ("J",), "0 to 1", "keypoint_confidence"),
    ArraySpec(
        "global_orient",
        "float32",
        (1, 3),
        "rotation vector about the pelvis joint, rad",
        "parameters.global_orient",
    ),
    ArraySpec("body_pose", "float32", (1, 63), "joints 1-21 of SMPL-X, rotation vectors, rad", "parameters.body_pose"),
    ArraySpec(
        "left_hand_pose",
        "float32",
        (1, 45),
        "index, middle, pinky, ring, thumb; rad, from a flat hand",
        "parameters.left_hand_pose",
    ),
    ArraySpec("right_hand_pose", "float32", (1, 45), "the same of the right hand", "parameters.right_hand_pose"),
    ArraySpec("jaw_pose", "float32", (1, 3), "rad", "parameters.jaw_pose"),
    ArraySpec("leye_pose", "float32", (1, 3), "rad", "parameters.leye_pose"),
    ArraySpec("reye_pose", "float32", (1, 3), "rad", "parameters.reye_pose"),
    ArraySpec("betas", "float32", (1, "K"), "shape, unit variance, for `body_model` only", "parameters.betas"),
    ArraySpec("expression", "float32", (1, "E"), "expression, for `body_model` only", "parameters.expression"),
    ArraySpec("transl", "float32", (1, 3), "m, added after posing", "parameters.transl"),
    ArraySpec("vertices", "float32", ("V", 3), "m, camera frame", "vertices", compact="grid"),
    ArraySpec("joints", "float32", (55, 3), "m, camera frame, SMPL-X order", "joints", compact="grid"),
    ArraySpec("contact", "bool", ("V",), "whether the vertex touches scene, floor or another person", "contact"),
    ArraySpec(
        "distance",
        "float32",
        ("V",),
        "signed distance to the scene or floor, m: < 0 inside, inf if none is near",
        "distance",
        compact="float16",
    ),
    ArraySpec(
        "contact_probability",
        "float16",
        ("V",),
        "probability that the vertex touches anything; absent if the preset estimates none",
        "contact_probability",
        optional=True,
    ),
    ArraySpec(
        "contact_partner",
        "int16",
        ("V",),
        "index into `contact_partners` of the JSON; -1 without contact",
        "contact_partner",
        optional=True,
    ),
)
"""Specifications of the arrays of each person, stored as ``person_0_box``, ``person_1_box``, ..."""

_STORED_AS_IS = ("float32", "float64")


def to_arrays(reconstruction: Reconstruction) -> dict[str, AnyArray]:
    """Convert a reconstruction to arrays, with the names, dtypes and shapes that this module documents."""
    floor = reconstruction.scene.floor
    converted: dict[str, Any] = {
        "intrinsics": reconstruction.intrinsics.matrix,
        "floor_normal": np.empty((0, 3)) if floor is None else np.asarray(floor.normal)[None],
        "body_model": reconstruction.body_model,
        "skeleton": getattr(reconstruction.skeleton, "name", reconstruction.skeleton),
    }
    arrays: dict[str, AnyArray] = {}
    for prefix, owner, specs in (
        ("", reconstruction, SHARED_ARRAYS),
        *((f"person_{index}_", person, PERSON_ARRAYS) for index, person in enumerate(reconstruction.people)),
    ):
        for spec in specs:
            value = attrgetter(spec.attribute)(owner) if spec.attribute else converted[spec.name]
            if value is not None or not spec.optional:
                arrays[prefix + spec.name] = _stored(value, spec)
    return arrays


def check_arrays(
    headers: Mapping[str, ArrayHeader],
    sizes: Mapping[str, int],
    people: int,
    specs: tuple[Iterable[ArraySpec], Iterable[ArraySpec]] = (SHARED_ARRAYS, PERSON_ARRAYS),
) -> None:
    """Check dtype and shape of every array that the tables name, and that arrays which share a size agree on it.

    Args:
        headers: of the arrays in a file; those that no table names are ignored.
        sizes: values of letters known from elsewhere.
        people: number of people.
        specs: tables of the shared arrays, and of those of each person.

    Raises:
        ValueError: an array has another dtype or shape, or arrays disagree about a size.
    """
    known = dict(sizes)
    named = [(spec.name, spec) for spec in specs[0]]
    named += [(f"person_{index}_{spec.name}", spec) for index in range(people) for spec in specs[1]]
    for name, spec in named:
        if name not in headers:
            continue
        header = headers[name]
        fits = len(header.shape) == len(spec.shape) and all(
            size == (known.setdefault(wanted, size) if isinstance(wanted, str) else wanted)
            for size, wanted in zip(header.shape, spec.shape, strict=True)
        )
        if not fits or not _has_dtype(header.dtype, spec.dtype):
            shape = tuple(known.get(size, size) if isinstance(size, str) else size for size in spec.shape)
            order = "" if header.dtype.isnative else " in the other byte order"
            wanted = str(shape).replace("'", "")
            raise ValueError(f"{name} is {header.dtype.name} {header.shape}{order}, not {spec.dtype} {wanted}")


def number_of_people(names: Iterable[str]) -> int:
    """Return the number of people for whom a file has arrays, by their names."""
    found = [name.split("_")[1] for name in names if name.startswith("person_")]
    return max((int(index) + 1 for index in found if index.isascii() and index.isdecimal()), default=0)


def _has_dtype(dtype: np.dtype[Any], wanted: str) -> bool:
    if wanted == "text":
        return dtype.kind == "U" and dtype.isnative
    return dtype.isnative and dtype.name in (_STORED_AS_IS if wanted == "floating" else (wanted,))


def _stored(value: Any, spec: ArraySpec) -> AnyArray:
    if spec.dtype == "text":
        return np.array(str(value))
    if spec.dtype == "floating":
        array = np.ascontiguousarray(value)
        return array if array.dtype.name in _STORED_AS_IS else array.astype(np.float64)
    return np.ascontiguousarray(value, dtype=spec.dtype)
