"""Convert a Pose2Sim project (calibration .toml, markers .trc) to a folder for ``physic evaluate calibrated``."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["convert_project", "read_calibration", "read_trc"]

NAMES = {"Shoulder": "shoulder", "Elbow": "elbow", "Wrist": "wrist", "Hip": "hip", "Knee": "knee", "Ankle": "ankle"}
SIDES = {"R": "right", "L": "left"}


def convert_project(project: Path, out: Path, frames: Sequence[int]) -> list[Path]:
    """Write cameras.json and joints.json, and the pictures of some frames from the project's videos.

    Args:
        project: has calibration/*.toml, pose-3d/*.trc and videos/NAME.* named as the cameras.
        out: new folder.
        frames: numbers of the .trc file's first column; moments of the evaluation.

    Raises:
        InputError: a file is missing or damaged, or a frame is not in it.
    """
    import cv2

    from physic_core.files.atomic import atomic_write, check_writable

    calibration = _one(project, "calibration/*.toml", "calib*/*.toml")
    trc = _one(project, "pose-3d/*.trc", "**/*.trc")
    cameras, (markers, unit) = read_calibration(calibration), read_trc(trc)
    unknown = [number for number in frames if number not in markers]
    if unknown:
        raise InputError(f"{trc} has no frame {unknown[0]}: it has {min(markers)} to {max(markers)}")
    check_writable(out)
    joints = {str(number): [{name: (unit * p).tolist() for name, p in markers[number].items()}] for number in frames}
    # Pose2Sim writes markers y up; its calibration has z up.
    for people in joints.values():
        for person in people:
            for name, (x, y, z) in person.items():
                person[name] = [z, x, y]
    written = []
    for name in cameras:
        film = next(iter(sorted((project / "videos").glob(f"{name}.*"))), None)
        if film is None:
            raise InputError(f"{project / 'videos'} has no video of the camera '{name}'")
        reader = cv2.VideoCapture(str(film))
        for number in frames:
            reader.set(cv2.CAP_PROP_POS_FRAMES, number)
            found, picture = reader.read()
            if not found:
                raise InputError(f"{film} has no frame {number}")
            path = out / f"{name}_{number}.png"
            with atomic_write(out) as temporary:
                temporary(path.name).write_bytes(cv2.imencode(".png", picture)[1].tobytes())
            written.append(path)
        reader.release()
    with atomic_write(out) as temporary:
        temporary("cameras.json").write_text(json.dumps({"cameras": cameras, "up": [0, 0, 1]}, indent=1))
        temporary("joints.json").write_text(json.dumps(joints, indent=1))
    return [*written, out / "cameras.json", out / "joints.json"]


def read_calibration(path: Path) -> dict[str, dict[str, Any]]:
    """Return the entries of cameras.json of a calibration file, by camera.

    Raises:
        InputError: it is no TOML, names no camera, or a camera is a fisheye.
    """
    import cv2

    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as TOML: {error}") from error
    cameras: dict[str, dict[str, Any]] = {}
    for key, table in tables.items():
        if not isinstance(table, Mapping) or "matrix" not in table:
            continue
        if table.get("fisheye"):
            raise InputError(f"{path}: camera '{key}' is a fisheye, whose distortion is not supported")
        lens = [float(v) for v in table["distortions"]]
        R, _ = cv2.Rodrigues(np.array(table["rotation"], np.float64))
        cameras[str(table.get("name", key))] = {
            "width": round(table["size"][0]),
            "height": round(table["size"][1]),
            "K": table["matrix"],
            "dist": [*lens, *[0.0] * (5 - len(lens))],
            "R": R.tolist(),
            "t_m": [float(v) for v in table["translation"]],
        }
    if not cameras:
        raise InputError(f"{path} names no camera")
    return cameras


def read_trc(path: Path) -> tuple[dict[int, dict[str, Array]], float]:
    """Return frame number -> joint name -> place (3,), and the factor of its unit to metres.

    Only limb joints are read: RShoulder ... LAnkle.

    Raises:
        InputError: it is no .trc file, or its unit is unknown.
    """
    try:
        lines = [line.rstrip("\n").split("\t") for line in path.read_text(encoding="utf-8").splitlines()]
        units = lines[2][lines[1].index("Units")].strip()
        columns = {
            f"{SIDES[name[0]]}_{NAMES[name[1:]]}": k
            for k, name in enumerate(lines[3])
            if name[:1] in SIDES and name[1:] in NAMES
        }
        found = {
            int(row[0]): {name: np.array([float(v) for v in row[k : k + 3]]) for name, k in columns.items()}
            for row in lines[5:]
            if row and row[0].strip().isdecimal()
        }
    except (OSError, IndexError, ValueError) as error:
        raise InputError(f"{path} is no complete .trc file ({error})") from error
    if units not in ("m", "mm"):
        raise InputError(f"{path}: the unit must be m or mm, got '{units}'")
    if not columns:
        raise InputError(
            f"{path} has none of the markers RShoulder, RElbow, RWrist, RHip, RKnee, RAnkle, LShoulder ..."
        )
    return found, 1.0 if units == "m" else 0.001


def _one(project: Path, *patterns: str) -> Path:
    for pattern in patterns:
        found = sorted(project.glob(pattern))
        if found:
            return found[0]
    raise InputError(f"{project} has no file {patterns[0]}")
