"""Read the calibration file (.toml) of a Pose2Sim project."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from physic_core.errors import InputError

KEYS = ("size", "matrix", "distortions", "rotation", "translation")
"""Entries of a camera."""


def read_calibration(path: Path) -> dict[str, dict[str, Any]]:
    """Return the cameras of a calibration file by name, each as an entry of cameras.json.

    Raises:
        InputError: it is not valid TOML, names no camera, or a camera is a fisheye or lacks an entry.
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
        missing = [name for name in KEYS if name not in table]
        if missing:
            raise InputError(f"{path}: camera '{key}' has no {', '.join(missing)}")
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
