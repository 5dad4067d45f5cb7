"""A smaller form of the arrays in ``reconstruction.npz``, about a third of the bytes, for many photos.

Scene points lie on the rays of the pixels: only their depth is stored, with 15 bits of mantissa, which changes it by
at most 0.0015 % (0.05 mm at 3 m). Normals have 8 bits per component (0.4 degrees at most). Both are stored as
differences from the left neighbour, which compress better. Vertices and joints of people are rounded to 1/16384 m
(0.03 mm at most), and distances of vertices to float16 (0.03 mm at 0.1 m). Scene colours are stored as differences
from the photo, which are 0 outside the removed people. Masks and keypoints are exact.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.io.arrays import PERSON_ARRAYS, SHARED_ARRAYS, ArraySpec

if TYPE_CHECKING:
    from collections.abc import Container, Iterable

    from numpy.typing import NDArray

    Arrays = dict[str, NDArray[Any]]

_MANTISSA_BITS = 15
_STEPS_PER_METRE = 16384
_NORMAL_STEPS = 127
_RAY_TOLERANCE = 2e-5  # of the depth; float32 arithmetic along a ray is within 1e-6

_REPLACED = {
    "scene_points": ArraySpec(
        "scene_depth_steps",
        "uint8",
        (3, "H", "W"),
        "z of the scene's points on the pixels' rays, m: the upper 24 bits of its float32, minus those of the pixel on "
        "the left, as bytes, the lowest first",
    ),
    "scene_normals": ArraySpec(
        "scene_normals_steps",
        "int8",
        ("H", "W", 3),
        "127 x the unit normal, 0 where unreliable, minus that of the pixel on the left, modulo 256",
    ),
    "scene_colors": ArraySpec(
        "scene_colors_change", "uint8", ("H", "W", 3), "RGB of the photo without people minus `image`, modulo 256"
    ),
}
COMPACT_SHARED_ARRAYS: tuple[ArraySpec, ...] = tuple(_REPLACED.get(spec.name, spec) for spec in SHARED_ARRAYS)
"""Specifications of the arrays that exist once per file."""

_OFF_RAYS = tuple(spec for spec in COMPACT_SHARED_ARRAYS if spec.name != "scene_depth_steps") + tuple(
    spec for spec in SHARED_ARRAYS if spec.name == "scene_points"
)
"""The same, if the points do not lie on the rays."""

COMPACT_PERSON_ARRAYS: tuple[ArraySpec, ...] = tuple(
    replace(spec, dtype="float16") if spec.compact == "float16" else spec for spec in PERSON_ARRAYS
)
"""Specifications of the arrays of each person."""

_OF_SCENE = ("image", "scene_", "floor_points")
_OF_PERSON = re.compile(r"person_[0-9]+_")
_FORMS = {spec.name: spec.compact for spec in SHARED_ARRAYS}
_PERSON_FORMS = {spec.name: spec.compact for spec in PERSON_ARRAYS}


def compact_arrays(arrays: Arrays) -> Arrays:
    """Convert the arrays of :func:`physic_core.io.arrays.to_arrays` to their smaller form; see the module."""
    small = {name: _compact(name, array) for name, array in arrays.items()}
    if "scene_points" in small:
        points = small.pop("scene_points")
        depth = _round_mantissa(points[..., 2])
        on_rays = _points_on_rays(depth, arrays["intrinsics"])
        near = np.abs(on_rays - points) <= _RAY_TOLERANCE * np.abs(points[..., 2:]) + np.float32(1e-6)
        if near.all():
            small["scene_depth_steps"] = _depth_steps(depth)
        else:
            small["scene_points"] = _round_mantissa(points)
        small["scene_normals_steps"] = _steps(small.pop("scene_normals"))
        small["scene_colors_change"] = small.pop("scene_colors") - arrays["image"]
    return small


def is_compact(names: Container[str]) -> bool:
    """Whether the arrays of a complete result have the smaller form, by their names."""
    return "scene_colors_change" in names


def is_kept_without_scene(name: str) -> bool:
    """Whether an array is also in the file of a result that was saved without its scene."""
    return not (name.startswith(_OF_SCENE) or name.endswith("_image"))


def expand_people(arrays: Arrays) -> Arrays:
    """Convert the arrays of people back from their smaller form."""
    return {name: a.astype(np.float32) if _form(name) == "float16" else a for name, a in arrays.items()}


def expand_arrays(arrays: Arrays) -> Arrays:
    """Convert arrays of the smaller form back; arrays of the usual form are returned as they are."""
    if not is_compact(arrays):
        return arrays
    found = expand_people(arrays)
    found["scene_colors"] = found.pop("scene_colors_change") + found["image"]
    if "scene_depth_steps" in found:
        found["scene_points"] = _points_on_rays(_depth_of_steps(found.pop("scene_depth_steps")), found["intrinsics"])
    normals = _sums(found.pop("scene_normals_steps")).astype(np.float32)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    found["scene_normals"] = normals / np.where(length > 0, length, 1)
    return found


def array_specs(arrays: Iterable[str], *, compact: bool) -> tuple[tuple[ArraySpec, ...], tuple[ArraySpec, ...]]:
    """Return the specifications of the arrays of a file, shared ones and those of each person.

    Args:
        arrays: names of the arrays in the file.
        compact: whether it has the smaller form.
    """
    names = set(arrays)
    of_people = {match.string[match.end() :] for name in names if (match := _OF_PERSON.match(name))}
    shared, of_person = (COMPACT_SHARED_ARRAYS, COMPACT_PERSON_ARRAYS) if compact else (SHARED_ARRAYS, PERSON_ARRAYS)
    if compact and "scene_points" in names:
        shared = _OFF_RAYS
    return (
        tuple(spec for spec in shared if not spec.optional or spec.name in names),
        tuple(spec for spec in of_person if not spec.optional or spec.name in of_people),
    )


def _form(name: str) -> str:
    match = _OF_PERSON.match(name)
    return _PERSON_FORMS.get(name[match.end() :], "exact") if match else _FORMS.get(name, "exact")


def _compact(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if name == "scene_normals":
        return np.round(_NORMAL_STEPS * array).astype(np.int8)
    if _form(name) == "grid":
        return (np.round(array * _STEPS_PER_METRE) / _STEPS_PER_METRE).astype(np.float32)
    return array.astype(np.float16) if _form(name) == "float16" else array


def _steps(values: NDArray[Any]) -> NDArray[Any]:
    """Return integers (H, W, ...) minus those on their left, modulo their size."""
    steps = values.copy()
    steps[:, 1:] -= values[:, :-1]
    return steps


def _sums(steps: NDArray[Any]) -> NDArray[Any]:
    return np.cumsum(steps, axis=1, dtype=steps.dtype)


def _depth_steps(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the differences (H, W) of depths of ``_MANTISSA_BITS`` bits as bytes (3, H, W)."""
    steps = _steps(depth.view(np.uint32) >> 8)
    return np.stack([steps, steps >> 8, steps >> 16]).astype(np.uint8)


def _depth_of_steps(steps: NDArray[np.uint8]) -> NDArray[np.float32]:
    low, middle, high = steps.astype(np.uint32)
    return (_sums(low | middle << 8 | high << 16) << 8).view(np.float32)


def _round_mantissa(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Round finite float32 numbers to ``_MANTISSA_BITS`` bits after the first."""
    drop = 23 - _MANTISSA_BITS
    bits = np.ascontiguousarray(values, np.float32).view(np.uint32)
    rounded = ((bits + np.uint32(1 << (drop - 1))) >> np.uint32(drop) << np.uint32(drop)).view(np.float32)
    return np.where(np.isfinite(values), rounded, values)


def _points_on_rays(depth: NDArray[np.float32], intrinsics: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the points (H, W, 3) of a depth map (H, W), m, with pixel centres at integers."""
    height, width = depth.shape
    x = (np.arange(width) - intrinsics[0, 2]) / intrinsics[0, 0]
    y = (np.arange(height) - intrinsics[1, 2]) / intrinsics[1, 1]
    return np.stack([depth * x, depth * y[:, None], depth], axis=-1).astype(np.float32)
