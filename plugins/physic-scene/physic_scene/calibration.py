"""Calibrated cameras from a TOML file with a table for each camera.

A photo belongs to the camera whose name it has: that of the file, of its beginning, or of its folder.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PositiveInt, TypeAdapter, ValidationError, model_validator
from scipy.spatial.transform import Rotation

from physic_core.errors import InputError
from physic_core.files.atomic import read_regular
from physic_core.types import CameraTrust, Intrinsics, Lens
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from typing import Self

    from physic_core.types import FloatArray

_ORTHONORMAL = 0.01  # largest deviation of R R^T from the identity; files have four digits or more
_LARGEST = 1e9  # number of an entry, in px or in the file's unit
_LARGEST_FILE = 1 << 20  # bytes; a camera takes less than 1,000
_LARGEST_UNIT = 1000.0  # metres

_Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
_Vector = tuple[_Number, _Number, _Number]


@dataclass(frozen=True)
class KnownCamera(ShortRepr):
    """A calibrated camera of one photo.

    Attributes:
        lens: matrix and distortion, px of the upright photo file.
        pose: (4, 4) rigid transform from the frame of the camera to that of the rig, metres; None where unknown.
    """

    lens: Lens
    pose: FloatArray | None = None


class _Table(BaseModel):
    """A camera of the file, in OpenCV's convention: a point x of the rig is ``R x + t`` in the frame of the camera."""

    model_config = ConfigDict(extra="forbid")

    size: tuple[PositiveInt, PositiveInt]
    K: tuple[_Vector, _Vector, _Vector]
    distortion: Annotated[tuple[_Number, ...], Field(max_length=5)] = ()
    R: tuple[_Vector, _Vector, _Vector] | None = None
    t: _Vector | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        (fx, skew, _), (zero, fy, _), last = self.K
        if min(fx, fy) <= 0 or skew or zero or last != (0, 0, 1):
            raise ValueError(f"K should be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] (got {self.K})")
        if len(self.distortion) not in (0, 4, 5):
            raise ValueError(f"distortion should be k1, k2, p1, p2 and perhaps k3 (got {self.distortion})")
        if (self.R is None) != (self.t is None):
            raise ValueError("R and t belong together: give both, or only K")
        if self.R is not None:
            R = np.array(self.R)
            if np.abs(R @ R.T - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(R) < 0:
                raise ValueError(f"R should be a rotation from the frame of the rig to that of the camera (got {R})")
        return self

    def camera(self, unit_m: float) -> KnownCamera:
        """Return the camera; its ``t`` is in a unit of this many metres."""
        (fx, _, cx), (_, fy, cy), _ = self.K
        k1, k2, p1, p2, k3 = (*self.distortion, *(5 - len(self.distortion)) * (0.0,))
        pose = None
        if self.R is not None and self.t is not None:
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_matrix(self.R).inv().as_matrix()
            pose[:3, 3] = -pose[:3, :3] @ self.t * unit_m
        return KnownCamera(
            Lens(Intrinsics(fx, fy, cx, cy, *self.size, trust=CameraTrust.KNOWN), (k1, k2, p1, p2, k3)), pose
        )


_FILE = TypeAdapter(dict[str, _Table])


def read_calibration(
    path: Path, photos: Sequence[Path], sizes: Sequence[tuple[int, int]], unit_m: float = 1.0
) -> list[KnownCamera | None]:
    """Return the camera of each photo, None for photos that the file does not name.

    Args:
        path: of the file.
        photos: their paths.
        sizes: width and height of each upright photo file, px.
        unit_m: length of the unit of ``t``, metres.

    Raises:
        InputError: the file cannot be read, a camera or the unit is invalid, or no camera is that of a photo.
    """
    if not 0 < unit_m <= _LARGEST_UNIT:
        raise InputError(f"the unit of {path} is {unit_m:g} m, but should be above 0 and at most {_LARGEST_UNIT:g} m")
    cameras = _tables(path)
    named = [_name_for(photo, cameras) for photo in photos]
    if not any(named):
        raise InputError(
            f"{path} has no camera for {', '.join(photo.name for photo in photos)}, but for {', '.join(cameras)}: the "
            "name of a photo, or of its folder, must be or begin with that of its camera"
        )
    for name, photo, size in zip(named, photos, sizes, strict=True):
        if name is not None and named.count(name) > 1:
            raise InputError(f"several photos are of camera {name} of {path}, such as {photo.name}: give one of each")
        if name is not None and cameras[name].size != size:
            raise InputError(
                f"camera {name} of {path} has a size of {cameras[name].size} px, and {photo.name} has {size}: give the "
                "photo as it was calibrated, or the calibration of its size"
            )
    return [None if name is None else cameras[name].camera(unit_m) for name in named]


def _tables(path: Path) -> Mapping[str, _Table]:
    """Return the tables of the file."""
    try:
        return _FILE.validate_python(tomllib.loads(read_regular(path, _LARGEST_FILE).decode("utf-8")))
    except ValidationError as error:
        problems = [f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors()]
        raise InputError(f"the cameras of {path} are invalid: {'; '.join(problems)}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cannot read the cameras of {path}: {error}") from error


def _name_for(photo: Path, cameras: Iterable[str]) -> str | None:
    """Return the longest name of a camera that the photo, its beginning or its folder has."""
    stem, folder = photo.stem, photo.resolve().parent.name

    def fits(name: str) -> bool:
        begins = stem.startswith(name) and not stem[len(name) : len(name) + 1].isalnum()
        return name in (photo.name, folder) or begins

    return max(filter(fits, cameras), key=len, default=None)
