"""Calibrated cameras from a file: own TOML, Pose2Sim's TOML, CMU Panoptic's JSON, and Colmap's text, each as it is.

All but Colmap's are records of a matrix, distortion, rotation, translation and size under names of their own (_KINDS).
A photo belongs to the camera whose name it has: that of the file, of its beginning, or of its folder.
"""

from __future__ import annotations

import json
import reprlib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.errors import InputError
from physic_core.files.regular import read_regular
from physic_core.types import CameraTrust, Intrinsics, Lens
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_ORTHONORMAL = 0.01  # largest deviation of R R^T from the identity; files have four digits or more
_FARTHEST_M = 1e5  # of a camera from the origin of its rig
_LARGEST = 1e9  # number of an entry, in px or in the file's unit
_LARGEST_FILE = 1 << 20  # bytes; a camera takes less than 1,000
_LARGEST_COLMAP_FILE = 1 << 28  # bytes; Colmap's images.txt lists the points of each image


@dataclass(frozen=True)
class KnownCamera(ShortRepr):
    """A calibrated camera of one photo.

    Attributes:
        lens: matrix and distortion, px of the upright photo file.
        pose: (4, 4) rigid transform from the frame of the camera to that of the rig, metres; None where unknown.
    """

    lens: Lens
    pose: FloatArray | None = None


class _Kind(NamedTuple):
    """A kind of file: names of its entries, length of its unit, metres, and what its camera names are wrapped in."""

    matrix: str
    distortion: str
    rotation: str
    translation: str
    size: str
    unit_m: float = 1.0
    wrapped: tuple[str, str] = ("", "")


_OWN = _Kind("K", "distortion", "R", "t", "size")
_POSE2SIM = _Kind("matrix", "distortions", "rotation", "translation", "size", wrapped=("int_", "_img"))
_PANOPTIC = _Kind("K", "distCoef", "R", "t", "resolution", unit_m=0.01)
_COLMAP_MODELS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
}


def read_calibration(
    path: Path, photos: Sequence[Path], sizes: Sequence[tuple[int, int]], unit_m: float | None = None
) -> list[KnownCamera | None]:
    """Return the camera of each photo, None for photos that the file does not name.

    Args:
        path: of the file; for Colmap, the folder of cameras.txt and images.txt, or one of them.
        photos: their paths.
        sizes: width and height of each upright photo file, px.
        unit_m: length of the file's unit, metres; None for that of its kind: a centimetre for CMU Panoptic's, else a
            metre.

    Raises:
        InputError: the file cannot be read, a camera is invalid, or none is that of a photo.
    """
    try:
        cameras = dict(_cameras(path, unit_m))
    except (OSError, ValueError, KeyError, OverflowError, RecursionError) as error:
        raise InputError(f"cannot read the cameras of {path}: {error}") from error
    named = [_name_for(photo, cameras) for photo in photos]
    if not any(named):
        raise InputError(
            f"{path} has no camera for {', '.join(photo.name for photo in photos)}, but for {', '.join(cameras)}: the "
            "name of a photo, or of its folder, must be or begin with that of its camera"
        )
    twice = {name: [p.name for p, n in zip(photos, named, strict=True) if n == name] for name in named if name}
    for name, own in twice.items():
        if len(own) > 1:
            raise InputError(f"{' and '.join(own)} are both photos of camera {name} of {path}: give one photo of each")
    return [
        None if name is None else _of_photo(cameras[name], f"{path}, camera {name}", photo, size)
        for name, photo, size in zip(named, photos, sizes, strict=True)
    ]


def _name_for(photo: Path, cameras: Mapping[str, object]) -> str | None:
    """Return the longest name of a camera that the photo, its beginning or its folder has."""
    stem, folder = photo.stem, photo.resolve().parent.name

    def fits(name: str) -> bool:
        begins = stem.startswith(name) and not stem[len(name) : len(name) + 1].isalnum()
        return name in (photo.name, folder) or begins

    return max((name for name in cameras if fits(name)), key=len, default=None)


def _of_photo(camera: KnownCamera, where: str, photo: Path, size: tuple[int, int]) -> KnownCamera:
    """Return a camera for a photo of a size; a file without a size has that of the photo."""
    own = camera.lens.intrinsics
    if (own.width, own.height) == (0, 0):
        intrinsics = Intrinsics(own.fx, own.fy, own.cx, own.cy, *size, own.source, own.trust)
        return KnownCamera(Lens(intrinsics, camera.lens.distortion), camera.pose)
    if (own.width, own.height) != size:
        raise InputError(
            f"{where} is of photos of {own.width} x {own.height} px, and {photo.name} has {size[0]} x {size[1]}: give "
            "the photo as it was calibrated, or the calibration of its size"
        )
    return camera


def _cameras(path: Path, unit_m: float | None) -> Iterator[tuple[str, KnownCamera]]:
    """Yield the name and the camera of each entry of a file."""
    if path.is_dir() or path.name in ("cameras.txt", "images.txt"):
        yield from _colmap(path if path.is_dir() else path.parent, unit_m or 1.0)
        return
    text = read_regular(path, _LARGEST_FILE).decode("utf-8")
    if path.suffix == ".json":
        kind, records = _PANOPTIC, _panoptic_records(path, json.loads(text))
    else:
        records = {name: record for name, record in tomllib.loads(text).items() if name != "metadata"}
        pose2sim = any(isinstance(record, dict) and "matrix" in record for record in records.values())
        kind = _POSE2SIM if pose2sim else _OWN
    if not records:
        raise InputError(f"{path} has no cameras: give a table for each, with {', '.join(_OWN[:5])}")
    for name, record in records.items():
        first, last = kind.wrapped
        plain = name.removeprefix(first).removesuffix(last)
        yield plain, _camera(record, kind, unit_m or kind.unit_m, f"{path}, camera {name}")


def _panoptic_records(path: Path, document: Any) -> dict[str, Any]:
    try:
        return {str(camera["name"]): camera for camera in document["cameras"]}
    except (TypeError, KeyError) as error:
        raise InputError(
            f"{path} is not a calibration of CMU Panoptic, which has a list of cameras, each with name, "
            f"{', '.join(_PANOPTIC[:5])}"
        ) from error


def _camera(record: Any, kind: _Kind, unit_m: float, where: str) -> KnownCamera:
    """Return the camera of a record."""
    if not isinstance(record, dict) or kind.matrix not in record:
        raise InputError(f"{where} has no {kind.matrix}: give the matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], px")
    if record.get("fisheye"):
        raise InputError(f"{where} is a fisheye, which has another model: undistort the photo, and give its pinhole")
    K = _numbers(record, kind.matrix, (9,), where).reshape(3, 3)
    if K[1, 0] or (K[2] != [0, 0, 1]).any() or K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(f"{where}: {kind.matrix} must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {K.tolist()}")
    if abs(K[0, 1]) > 1e-6 * K[0, 0]:
        raise InputError(f"{where}: {kind.matrix} has a skew of {K[0, 1]:g} px: calibrate without one")
    width, height = (int(side) for side in _numbers(record, kind.size, (2,), where)) if kind.size in record else (0, 0)
    distortion = _numbers(record, kind.distortion, (0, 4, 5), where) if kind.distortion in record else np.zeros(0)
    pose = None
    if kind.rotation in record or kind.translation in record:
        rotation = _rotation(_numbers(record, kind.rotation, (3, 9), where), f"{where}: {kind.rotation}")
        pose = _pose(rotation, unit_m * _numbers(record, kind.translation, (3,), where), where)
    return _known(K[[0, 1, 0, 1], [0, 1, 2, 2]], (width, height), distortion, pose)


def _known(camera: FloatArray, size: tuple[int, int], distortion: FloatArray, pose: FloatArray | None) -> KnownCamera:
    fx, fy, cx, cy = camera.tolist()
    k1, k2, p1, p2, k3 = np.append(distortion, np.zeros(5 - len(distortion))).tolist()
    return KnownCamera(Lens(Intrinsics(fx, fy, cx, cy, *size, trust=CameraTrust.KNOWN), (k1, k2, p1, p2, k3)), pose)


def _numbers(record: Mapping[str, Any], name: str, counts: tuple[int, ...], where: str) -> FloatArray:
    """Return the numbers of an entry, flat."""
    try:
        found = np.array(record.get(name), np.float64).reshape(-1)
    except (TypeError, ValueError, OverflowError):
        found = np.full(1, np.nan)
    if len(found) not in counts or not (np.abs(found) < _LARGEST).all():
        expected = " or ".join(str(count) for count in counts if count)
        got = reprlib.repr(record.get(name))
        raise InputError(f"{where}: {name} must have {expected} numbers below {_LARGEST:g}, got {got}")
    return found


def _rotation(numbers: FloatArray, where: str) -> FloatArray:
    """Return a rotation (3, 3) from a matrix or a rotation vector."""
    if len(numbers) == 3:
        turned: FloatArray = Rotation.from_rotvec(numbers).as_matrix()
        return turned
    matrix = numbers.reshape(3, 3)
    off = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if off > _ORTHONORMAL or np.linalg.det(matrix) < 0:
        why = f"its R R^T is {off:.2g} off the identity" if off > _ORTHONORMAL else "it is a reflection"
        raise InputError(f"{where} must be a rotation from the frame of the rig to that of the camera: {why}")
    u, _, vt = np.linalg.svd(matrix)
    nearest: FloatArray = u @ vt
    return nearest


def _pose(rotation: FloatArray, translation: FloatArray, where: str) -> FloatArray:
    """Return the transform (4, 4) to the rig, for cameras that see x at ``rotation @ x + translation``."""
    if not (np.abs(np.append(rotation, translation)) < _FARTHEST_M).all():
        raise InputError(f"{where} has no pose within {_FARTHEST_M:g} m of the origin: correct it, or its unit")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.T, -rotation.T @ translation
    return pose


def _colmap(folder: Path, unit_m: float) -> Iterator[tuple[str, KnownCamera]]:
    """Yield the cameras of Colmap's cameras.txt and images.txt, whose pixels have their centres at .5."""
    cameras = {}
    for line in _lines(folder / "cameras.txt"):
        number, model, width, height, *values = line.split()
        if model not in _COLMAP_MODELS:
            raise InputError(
                f"{folder / 'cameras.txt'}: camera {number} has model {model}: undistort the photos with `colmap "
                f"image_undistorter`, or use one of {', '.join(_COLMAP_MODELS)}"
            )
        given = dict(zip(_COLMAP_MODELS[model].split(), map(float, values), strict=False))
        focal = given.get("f", 0.0)
        pinhole = [given.get("fx", focal), given.get("fy", focal), given["cx"] - 0.5, given["cy"] - 0.5]
        distortion = [given.get(name, 0.0) for name in ("k1", "k2", "p1", "p2")]
        cameras[number] = np.array(pinhole), (int(width), int(height)), np.array(distortion)
    # Of each two lines of images.txt, the second lists points, and can be empty.
    for line in _lines(folder / "images.txt", every=2):
        _, *numbers, camera, name = line.split(maxsplit=9)
        quaternion, translation = np.array(numbers[:4], np.float64), np.array(numbers[4:], np.float64)
        rotation = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        where = f"{folder / 'images.txt'}, image {name}"
        yield Path(name).name, _known(*cameras[camera], _pose(rotation, unit_m * translation, where))


def _lines(path: Path, every: int = 1) -> list[str]:
    text = read_regular(path, _LARGEST_COLMAP_FILE).decode("utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [line for line in lines[::every] if line.strip()]
