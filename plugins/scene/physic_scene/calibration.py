"""Calibrated cameras of photos from a file of PhySIC or of another program.

A photo belongs to the camera whose name it has: that of the file, of its beginning, or of its
folder. If each camera is that of one image, the photo has the name of this image. If no photo has
a name of the file, cameras are taken in order.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import combinations
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from scipy.spatial.transform import Rotation

from physic_core.errors import ConfigError, InputError
from physic_core.files import count, number, unreadable
from physic_core.types import CameraTrust, Intrinsics, Lens, ShortRepr
from physic_scene.calibration_formats import CameraFile, read_camera_file

if TYPE_CHECKING:
    from typing import Self

    from physic_core.types import FloatArray

_NAMED = 8  # names of a message
_NEAR_NAME = 0.75  # similarity of two names that may be one
_ORTHONORMAL = 0.01  # largest deviation of R R^T from the identity; files have four digits or more
_FARTHEST_APART = 100.0  # metres
_LARGEST = 1e9  # number of an entry, in px or in the file's unit
_LARGEST_UNIT = 1000.0  # metres
_OFF_CENTRE = 0.1  # of width or height; a principal point farther off is that of another picture

_Number = Annotated[
    float, BeforeValidator(lambda v: number(v, "it")), Field(ge=-_LARGEST, le=_LARGEST)
]
_Side = Annotated[int, BeforeValidator(lambda v: count(v, "it")), Field(gt=0)]
_Vector = tuple[_Number, _Number, _Number]


@dataclass(frozen=True)
class KnownCamera(ShortRepr):
    """A calibrated camera of one photo.

    Attributes:
        lens: matrix and distortion, px of the upright photo file.
        pose: (4, 4) rigid transform from the frame of the camera to that of the rig, metres; None
            where unknown.
        name: in the file.
        by_order: whether the photo has it by its place, as no photo has the name of a camera.
    """

    lens: Lens
    pose: FloatArray | None = None
    name: str = ""
    by_order: bool = False


class _CameraTable(BaseModel):
    """A camera of the file, in OpenCV's convention: a point x of the rig is ``R x + t`` in the
    frame of the camera.
    """

    model_config = ConfigDict(extra="forbid")

    size: tuple[_Side, _Side] | None
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
            raise ValueError(
                f"distortion should be k1, k2, p1, p2 and perhaps k3 (got {self.distortion})"
            )
        self.distortion += (5 - len(self.distortion)) * (0.0,)
        if (self.R is None) != (self.t is None):
            raise ValueError("R and t belong together: give both, or only K")
        if self.R is not None:
            R = np.array(self.R)
            if np.abs(R @ R.T - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(R) < 0:
                raise ValueError(
                    f"R should be a rotation from the frame of the rig to that of the camera (got "
                    f"{R})"
                )
        return self

    def turned(self) -> Self:
        """Return the camera of the picture turned by 90 degrees clockwise; the size is known."""
        (fx, _, cx), (_, fy, cy), _ = self.K
        k1, k2, p1, p2, k3 = self.distortion
        width, height = self.size or (0, 0)
        changes: dict[str, Any] = {
            "size": (height, width),
            "K": ((fy, 0, height - 1 - cy), (0, fx, cx), (0, 0, 1)),
            "distortion": (k1, k2, p2, -p1, k3),
        }
        if self.R is not None:
            turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
            changes |= {"R": turn @ self.R, "t": turn @ self.t}
        return self.model_copy(update=changes)

    def fits(self, size: tuple[int, int]) -> bool:
        """Return whether this is the stated size, or one with the principal point in the middle."""
        near = all(abs(self.K[i][2] / size[i] - 0.5) < _OFF_CENTRE for i in (0, 1))
        return near if self.size is None else self.size == size

    def camera(self, unit_m: float, size: tuple[int, int]) -> KnownCamera:
        """Return the camera of a photo of this size; ``t`` is in a unit of this many metres."""
        (fx, _, cx), (_, fy, cy), _ = self.K
        k1, k2, p1, p2, k3 = self.distortion
        pose = None
        if self.R is not None and self.t is not None:
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_matrix(self.R).inv().as_matrix()
            pose[:3, 3] = -pose[:3, :3] @ self.t * unit_m
        intrinsics = Intrinsics(fx, fy, cx, cy, *size, trust=CameraTrust.KNOWN)
        return KnownCamera(Lens(intrinsics, (k1, k2, p1, p2, k3)), pose)


def read_calibration(
    path: Path,
    photos: Sequence[Path],
    sizes: Sequence[tuple[int, int]],
    unit_m: float | None = None,
) -> list[KnownCamera | None]:
    """Return the camera of each photo, None for photos that the file does not name.

    Args:
        path: of the file, or of a folder with files of COLMAP, EasyMocap or nerfstudio.
        photos: their paths.
        sizes: width and height of each upright photo file, px.
        unit_m: length of the unit of ``t``, metres; None for 1, except for COLMAP and nerfstudio.

    Raises:
        ConfigError: the unit is invalid or missing.
        InputError: the file cannot be read, a camera is invalid, has nearly the name of a photo, or
            is of no photo, a photo has another size than its camera, or cameras are over 100 m
            apart without a unit.
    """
    if unit_m is not None and not 0 < unit_m <= _LARGEST_UNIT:
        raise ConfigError(
            f"the unit of {path} is {unit_m:g} m, but should be above 0 and at most "
            f"{_LARGEST_UNIT:g} m"
        )
    rig, cameras = _cameras(path)
    if rig.names_are_images and unit_m is None:
        raise ConfigError(
            f"the unit of {path} is not known, as COLMAP and nerfstudio choose their own: give its "
            "length in meters by --camera-unit (unit_m in Python), which is a known distance "
            "divided by the same distance in the file"
        )
    find = _image_for if rig.names_are_images else _name_for
    named = [find(photo, cameras) for photo in photos]
    by_order = not any(named) and not rig.names_are_images and len(cameras) == len(photos)
    if by_order:
        named = list(cameras)
    if not any(named):
        raise InputError(
            f"{path} has no camera for {', '.join(photo.name for photo in photos)}, but for "
            f"{', '.join([*cameras][:_NAMED]) or 'none'}: the name of a photo, or of its folder, "
            "must be or begin with that of its camera"
        )
    _refuse_near_names(path, photos, named, cameras)
    known_cameras: list[KnownCamera | None] = []
    for name, photo, size in zip(named, photos, sizes, strict=True):
        if name is not None and named.count(name) > 1:
            raise InputError(
                f"several photos are of camera {name} of {path}, such as {photo.name}: give one "
                f"photo per camera"
            )
        if name is None:
            known_cameras.append(None)
            continue
        fitting = [
            camera
            for camera in _possible_cameras(cameras[name], rig.turns.get(name, 0))
            if camera.fits(size)
        ]
        if len(fitting) != 1:
            stated = cameras[name].size or "no size, and its principal point is off center"
            cause = "is turned or not" if fitting else f"has {size}"
            raise InputError(
                f"camera {name} of {path} has {stated}, and {photo.name} {cause} px: give the "
                "photo as it was calibrated, or the calibration of its size"
            )
        known_cameras.append(
            replace(fitting[0].camera(unit_m or 1.0, size), name=name, by_order=by_order)
        )
    if unit_m is None:
        _require_metres(path, known_cameras)
    return known_cameras


def _require_metres(path: Path, cameras: Sequence[KnownCamera | None]) -> None:
    """Refuse cameras that are too far apart to see the same people, before any photo is
    reconstructed.
    """
    places = [
        camera.pose[:3, 3] for camera in cameras if camera is not None and camera.pose is not None
    ]
    apart = max((float(np.linalg.norm(a - b)) for a, b in combinations(places, 2)), default=0.0)
    if apart > _FARTHEST_APART:
        raise InputError(
            f"two cameras of {path} are {apart:.0f} m apart: give the length of its unit with "
            "--camera-unit (unit_m in Python), such as 0.001 for millimeters"
        )


def _possible_cameras(table: _CameraTable, turns: int) -> list[_CameraTable]:
    """Return the camera of the recorded picture, and that of the picture after its turns."""
    upright = table
    for _ in range(turns % 4):
        upright = upright.turned()
    return [table, upright] if turns % 4 else [table]


_FILE = TypeAdapter(dict[str, _CameraTable])


def _cameras(path: Path) -> tuple[CameraFile, Mapping[str, _CameraTable]]:
    """Return the file, and its cameras by name."""
    try:
        rig = read_camera_file(path)
        if others := [name for name, one in rig.tables.items() if not isinstance(one, Mapping)]:
            raise ValueError(
                f"{others[0]} is no table: write [NAME] for each camera, with size, K, and perhaps "
                "distortion, R and t"
            )
        return rig, _FILE.validate_python(rig.tables)
    except ValidationError as error:
        problems = [f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors()]
        raise InputError(f"the cameras of {path} are invalid: {'; '.join(problems)}") from error
    except KeyError as error:
        cure = "docs/tools.md has the files that are read"
        raise InputError(f"cannot read the cameras of {path}: it lacks {error}; {cure}") from error
    except OSError as error:
        raise InputError(f"cannot read the cameras of {path}: {unreadable(error)}") from error
    except (ValueError, TypeError, LookupError, ArithmeticError, RecursionError) as error:
        raise InputError(f"cannot read the cameras of {path}: {error}") from error


def _refuse_near_names(
    path: Path, photos: Sequence[Path], named: Sequence[str | None], cameras: Iterable[str]
) -> None:
    """Refuse a camera without a photo whose name is nearly that of a photo without a camera.

    Raises:
        InputError: there is one.
    """
    free = {PurePosixPath(name).stem.lower(): name for name in cameras if name not in named}
    for photo, name in zip(photos, named, strict=True):
        stem = photo.stem.lower()
        first = re.split(r"[\W_]", stem)[0]
        own = [] if name else [stem, first, photo.resolve().parent.name.lower()]
        for near in (key for text in own for key in get_close_matches(text, free, 1, _NEAR_NAME)):
            raise InputError(
                f"{photo.name} has no camera in {path}, and camera {free[near]} has no photo: if "
                f"they belong together, give both the same name; if not, leave out the camera"
            )


def _name_for(photo: Path, cameras: Iterable[str]) -> str | None:
    """Return the longest name of a camera that the photo, its beginning or its folder has."""
    stem = photo.stem
    folder = photo.resolve().parent.name

    def fits(name: str) -> bool:
        begins = stem.startswith(name) and not stem[len(name) : len(name) + 1].isalnum()
        return name in (photo.name, folder) or begins

    return max(filter(fits, cameras), key=len, default=None)


def _image_for(photo: Path, images: Iterable[str]) -> str | None:
    """Return the image of this name without its suffix; of several, the one of the same folder."""
    same = [name for name in images if PurePosixPath(name).stem == photo.stem]
    near = [name for name in same if PurePosixPath(name).parent.name == photo.resolve().parent.name]
    candidates = same if len(same) == 1 else near
    return candidates[0] if len(candidates) == 1 else None
