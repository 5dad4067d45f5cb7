"""Cameras as other programs write them, as tables of PhySIC's own form."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.files import (
    boolean,
    count,
    identity,
    matrix,
    number,
    parse_json,
    parse_toml,
    read_text,
)

if TYPE_CHECKING:
    from physic_core.types import Float64Array

_LARGEST_FILE = 1 << 24  # bytes
_LARGEST_MODEL = 1 << 28  # bytes of COLMAP's images.txt, which has all keypoints
_IN_FOLDERS = ("cameras.txt", "cameras.bin", "intri.yml", "transforms.json", "camera_array.toml")
_NAMED = 5  # keys of a message
_OPENGL = (1, -1, -1)  # OpenCV's axes in those of OpenGL, which nerfstudio uses

_COLMAP = {
    "SIMPLE_PINHOLE": "fx cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "fx cx cy k1",
    "RADIAL": "fx cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
}
"""Parameters of COLMAP's models that OpenCV's five coefficients can state."""


@dataclass(frozen=True)
class CameraFile:
    """Cameras of a file, in OpenCV's convention.

    Attributes:
        tables: of each camera by its name, as in PhySIC's own TOML; ``size`` is None if not stated.
        turns: quarter turns clockwise, by name, that make the picture of a camera upright.
        names_are_images: whether the names are paths of single images, and the unit is arbitrary.
    """

    tables: Mapping[str, Any]
    turns: Mapping[str, int] = field(default_factory=dict)
    names_are_images: bool = False


def read_camera_file(path: Path) -> CameraFile:
    """Return the cameras of a file, or of a folder with files of COLMAP, EasyMocap or nerfstudio.

    Raises:
        OSError: a file cannot be read.
        ValueError: it has no known form, or a lens that is not supported.
        LookupError, TypeError, ArithmeticError, RecursionError: an entry is missing or damaged.
    """
    files = [path / name for name in _IN_FOLDERS if (path / name).exists()]
    path = files[0] if files else path
    return _FORMS.get(path.suffix.lower(), _read_toml)(path)


def _read_text(path: Path, limit: int = _LARGEST_FILE) -> str:
    return read_text(path, limit)


def _unsupported(name: str, lens: str) -> ValueError:
    return ValueError(
        f"the lens of camera {name} is {lens}, and only pinhole cameras with k1, k2, p1, p2, k3 "
        "can be used: remove the distortion of its photos (colmap image_undistorter, "
        "cv2.fisheye.undistortImage), and give the cameras of the new photos"
    )


def _refuse_unread_keys(name: str, keys: Iterable[str], read: Collection[str]) -> None:
    """Raise ValueError if an entry of a file has a key that is not read: it could change the
    camera.
    """
    if others := [key for key in keys if key not in read]:
        raise ValueError(
            f"{name} has {', '.join(others[:_NAMED])}, which no reader here knows: remove it, or "
            f"call it by the name that the other program gives it"
        )


def _add_once(entries: dict[str, Any], name: str, entry: Any) -> None:
    if name in entries:
        raise ValueError(f"it has {name} twice: remove one")
    entries[name] = entry


def _pose_fields(rotation: Any, translation: Any) -> dict[str, Any]:
    """Return R and t, or nothing if not known; the rotation is a vector (Rodrigues) or a matrix."""
    is_text = isinstance(rotation, str)
    if rotation is None or (is_text and rotation == "null"):  # Caliscope has written the text
        return {}
    values = matrix(rotation, "a rotation")
    R = (
        Rotation.from_rotvec(values.ravel()).as_matrix()
        if values.size == 3
        else values.reshape(3, 3)
    )
    return {"R": R.tolist(), "t": matrix(translation, "a translation").ravel().tolist()}


def _coefficients(values: Any) -> list[float]:
    """Return the coefficients of OpenCV without zeros after the fifth."""
    coefficients: list[float] = (
        matrix([] if values is None else values, "distortion").ravel().tolist()
    )
    return coefficients if any(coefficients[5:]) else coefficients[:5]


_TOML_KEYS = (
    *("name", "size", "matrix", "distortions", "rotation", "translation", "fisheye", "ignore"),
    *("rotation_count", "cam_id", "error", "grid_count"),
)
"""What Pose2Sim, AniPose and Caliscope write of a camera."""


def _read_toml(path: Path) -> CameraFile:
    """Read PhySIC's own form, or that of Pose2Sim, AniPose and Caliscope, which have ``matrix``."""
    document = parse_toml(_read_text(path))
    nested = isinstance(document.get("cameras"), dict)  # as Caliscope does by itself
    entries: Mapping[str, Any] = document["cameras"] if nested else document
    tables: dict[str, Any] = {}
    turns: dict[str, int] = {}
    cameras = [
        key
        for key, entry in entries.items()
        if isinstance(entry, dict) and isinstance(entry.get("matrix"), list)
    ]
    if not cameras:
        return CameraFile(document)
    _refuse_unread_keys(
        "the file", document if nested else entries, ("cameras", "metadata", *cameras)
    )
    _refuse_unread_keys("its metadata", document.get("metadata", ()), ("adjusted", "error"))
    for key in cameras:
        entry = entries[key]
        name = identity(entry.get("name", f"cam_{key}" if nested else key), "the name of a camera")
        if boolean(entry.get("ignore"), f"ignore of camera {name}"):
            continue
        _refuse_unread_keys(f"camera {name}", entry, _TOML_KEYS)
        if boolean(entry.get("fisheye"), f"fisheye of camera {name}"):
            raise _unsupported(name, "a fisheye (AniPose's and Caliscope's `fisheye = true`)")
        table = {
            "size": entry["size"],
            "K": entry["matrix"],
            "distortion": _coefficients(entry.get("distortions")),
            **_pose_fields(entry.get("rotation"), entry.get("translation")),
        }
        _add_once(tables, name, table)
        turns[name] = count(entry.get("rotation_count", 0), f"rotation_count of camera {name}")
    return CameraFile(tables, turns)


# Read without OpenCV, whose parser answers damaged text with SystemError.
_ENTRY = re.compile(r"^([^\s:-][^\s:]*):(.*(?:\n(?:[ \t-].*)?)*)", re.M)
_COMMENT = re.compile(r"(?:^|\s)#.*$|^(?:%|---).*$", re.M)
_YAML_KEYS = ("K", "dist", "R", "Rot", "T", "H", "W")
"""What EasyMocap writes of a camera, before its name."""


def _read_easymocap(path: Path) -> CameraFile:
    """Read EasyMocap's intri.yml and extri.yml, of which either is given."""
    pair = path.parent.glob(re.sub("intri|extri", "??tri", path.name))
    text = "\n".join(map(_read_text, sorted({path, *pair})))
    entries: dict[str, str] = {}
    for key, value in _ENTRY.findall(_COMMENT.sub("", text)):
        if key != "names":  # each of the two files has it
            _add_once(entries, key, value)
    names = [key[2:] for key in entries if key.startswith("K_")]
    if names:
        known = {f"{kind}_{name}" for kind in _YAML_KEYS for name in names}
        _refuse_unread_keys("the file", entries, known)
    sides = {key: entries.pop(key).strip() for key in [*entries] if key[:2] in ("W_", "H_")}
    numbers = {key: _read_matrix(key, value) for key, value in entries.items()}
    tables = {}
    for name in names:
        size = [sides.get(f"{side}_{name}", "") for side in "WH"]
        turn = numbers.get(f"Rot_{name}")
        vector = numbers.get(f"R_{name}", turn)
        if turn is not None and not np.allclose(
            _pose_fields(turn, 0)["R"], _pose_fields(vector, 0)["R"], atol=0.01
        ):
            raise ValueError(f"its R_{name} and Rot_{name} differ: remove one")
        tables[name] = {
            "size": [int(side or 0) for side in size] if all(size) else None,
            "K": numbers[f"K_{name}"].reshape(3, 3).tolist(),
            "distortion": _coefficients(numbers.get(f"dist_{name}")),
            **_pose_fields(vector, numbers.get(f"T_{name}")),
        }
    return CameraFile(tables)


_MATRIX = re.compile(
    r"\s*(?:!!opencv-matrix)?\s*rows: *(\d+)\s+cols: *(\d+)[^[]*data: *\[([^]]*)\]\s*"
)


def _read_matrix(name: str, text: str) -> Float64Array:
    if (match := _MATRIX.fullmatch(text)) is not None:
        values = np.array(match[3].split(","), np.float64)
        if values.size == int(match[1]) * int(match[2]):
            return values
    raise ValueError(f"{name} is not an OpenCV matrix with rows, cols and data")


# Of a lens, beside the five coefficients: thin prisms, tilts, skew, other names of distortion.
_FAR = re.compile(r"k[04-9]|p[03-9]|[st]\w?\d|.*(?:dist|fisheye|skew|lens|rolling).*", re.I)


def _lens(name: str, model: str, size: Sequence[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the lens of COLMAP and nerfstudio, whose pixels have their centres at .5."""
    far = [f"{key} = {values[key]}" for key in values if _FAR.fullmatch(key) and values[key]]
    if far or model not in _COLMAP:
        raise _unsupported(name, " with ".join((model, *far)))
    cx, cy = (number(values[key], f"{key} of {name}") - 0.5 for key in ("cx", "cy"))
    return {
        "size": size,
        "K": [[values["fx"], 0, cx], [0, values["fy"], cy], [0, 0, 1]],
        "distortion": [values.get(key, 0) for key in ("k1", "k2", "p1", "p2", "k3")],
    }


_OF_NERFSTUDIO = (
    *("camera_model", "fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2"),
    *("camera_angle_x", "camera_angle_y", "is_fisheye", "frames", "file_path", "transform_matrix"),
    *("colmap_im_id", "mask_path", "depth_file_path", "normal_file_path", "sharpness", "timestamp"),
    *("time", "integer_depth_scale", "enable_depth_loading", "applied_transform", "applied_scale"),
    *("aabb", "aabb_scale", "scale", "offset", "from_na", "render_aabb", "ply_file_path"),
    *("orientation_override", "train_filenames", "val_filenames", "test_filenames"),
)
"""What nerfstudio and instant-ngp write of a scene and of a frame."""


def _read_nerfstudio(path: Path) -> CameraFile:
    """Read nerfstudio's transforms.json, which instant-ngp has as well."""
    document = parse_json(_read_text(path))
    tables: dict[str, Any] = {}
    for frame in document["frames"]:
        if other := [key for key in frame if document.get(key, frame[key]) != frame[key]]:
            raise ValueError(f"its {other[0]} differs from that of {frame['file_path']}: keep one")
        one = frame | document
        name = identity(one["file_path"], "file_path")
        model = one.get("camera_model", "OPENCV")
        values = one | {"fx": one["fl_x"], "fy": one["fl_y"]}
        to_world = matrix(one["transform_matrix"], f"transform_matrix of {name}")[:3]
        R = (to_world[:, :3] * _OPENGL).T
        lens = _lens(name, model, (one["w"], one["h"]), values)
        _refuse_unread_keys(f"camera {name}", one, _OF_NERFSTUDIO)
        _add_once(tables, name, lens | _pose_fields(R, -R @ to_world[:, 3]))
    return CameraFile(tables, names_are_images=True)


def _read_rows(path: Path) -> Iterator[str]:
    """Return the lines of COLMAP's text that are no comments."""
    lines = _read_text(path, _LARGEST_MODEL).rstrip().splitlines()
    return (line for line in lines if not line.startswith("#"))


def _read_colmap(path: Path) -> CameraFile:
    """Read cameras.txt and images.txt; a point x of the world is at R x + t of each image."""
    lenses: dict[str, Any] = {}
    for line in _read_rows(path.with_name("cameras.txt")):
        number, model, width, height, *numbers = line.split()
        keys = _COLMAP.get(model, "").split() or numbers
        values: dict[str, float] = dict(zip(keys, map(float, numbers), strict=True))
        values.setdefault("fy", values.get("fx", 0))
        _add_once(lenses, number, _lens(number, model, (int(width), int(height)), values))
    tables: dict[str, Any] = {}
    lines = _read_rows(path.with_name("images.txt"))
    for line in lines:
        _, *numbers, camera, name = line.split(maxsplit=9)
        *quaternion, x, y, z = map(float, numbers)
        R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        _add_once(tables, name, lenses[camera] | _pose_fields(R, (x, y, z)))
        next(lines, None)  # its keypoints, which may be none
    return CameraFile(tables, names_are_images=True)


def _refuse_binary(path: Path) -> CameraFile:
    raise ValueError(
        "a model of COLMAP is read as text: colmap model_converter --input_path "
        f"{path.parent} --output_path {path.parent} --output_type TXT, then name cameras.txt"
    )


_FORMS: dict[str, Callable[[Path], CameraFile]] = {
    ".json": _read_nerfstudio,
    ".yml": _read_easymocap,
    ".yaml": _read_easymocap,
    ".txt": _read_colmap,
    ".bin": _refuse_binary,
}
