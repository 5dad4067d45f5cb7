"""EMDB: SMPL bodies from electromagnetic sensors, in the frame of a moving phone camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_core.errors import InputError
from physic_evaluate.cameras import Camera
from physic_evaluate.contract import Frame, Picture, TruePerson, Truth
from physic_evaluate.damage import (
    DamagedFileError,
    finite_number,
    gender_of,
    naming,
    number_array,
    number_row,
    require_finite,
    require_rotation,
    table,
)
from physic_evaluate.datasets.base import DataSet, Description, FrameSet, Source, missing_file_messages, option
from physic_evaluate.pickled import cached_pickle

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_evaluate.bodies import BodyFiles

    Array = NDArray[np.float64]

__all__ = ["DATA_SET", "Emdb", "EmdbOptions"]

MAX_JOINT_ERROR_PX = 15.0
"""Median distance of projected joints from the set's own 2D joints; a model file of another gender gives less."""

TREE = """\
ROOT/
  P0/ ... P9/
    <sequence>/
      images/00000.jpg ...            pictures
      P0_<sequence>_data.pkl          camera, SMPL parameters, good_frames_mask, kp2d, emdb1, emdb2"""


@dataclass(frozen=True)
class EmdbOptions:
    """Options of the command.

    Attributes:
        part: "1" or "2", the sequences with that flag; "all".
        every: step through the frames of each sequence.
    """

    part: str = option("1", "Sequences of EMDB 1, of EMDB 2, or all.", metavar="1|2|all")
    every: int = option(30, "Every N-th good frame of each sequence.", metavar="N")


class Emdb(DataSet):
    """Reads single frames; metrics of films (WA-MPJPE, jitter) are not computed."""

    name: ClassVar[str] = "emdb"
    summary: ClassVar[str] = "EMDB"
    Options: ClassVar[type[Any]] = EmdbOptions

    def describe(self) -> Description:
        """Return what EMDB needs."""
        return Description(
            "EMDB: one person outdoors and indoors before a moving camera, with SMPL bodies from sensors.",
            (
                Source("P0 to P9", "the site of EMDB, eth-ait.github.io/emdb, by a request form", "CC BY-NC-SA 4.0"),
                Source(
                    "SMPL model files SMPL_{NEUTRAL,MALE,FEMALE}.pkl (--smpl FOLDER)",
                    "the site of SMPL, smpl.is.tue.mpg.de, with an account",
                    "SMPL licence: non-commercial research",
                ),
            ),
            TREE,
            (
                "Only frames of good_frames_mask are evaluated, every n-th of them (--every); each frame alone, in the "
                "camera frame.",
                "Bodies are SMPL of the sequence's gender. The extrinsics bring them from the world into the camera; a "
                "sequence whose projected joints are not at its own 2D joints is refused.",
            ),
        )

    def check(self, root: Path, options: EmdbOptions, *, pictures: bool = True) -> list[str]:
        """Return the missing files."""
        needed = [("P*/*/*_data.pkl", "camera and bodies of the sequences")]
        if pictures:
            needed.append(("P*/*/images/*.jpg", "pictures"))
        missing = missing_file_messages(root, needed)
        if options.part not in ("1", "2", "all"):
            missing.append(f"--part is 1, 2 or all (got '{options.part}')")
        if options.every < 1:
            missing.append(f"--every is at least 1 (got {options.every})")
        return missing

    def frames(self, root: Path, options: EmdbOptions, bodies: BodyFiles) -> FrameSet:
        """Return the frames."""
        if not bodies.has("smpl"):
            raise InputError("EMDB holds parameters of SMPL: give --smpl FOLDER with SMPL_NEUTRAL, _MALE and _FEMALE")
        frames: list[Frame] = []
        left_out: dict[str, str] = {}
        for file in sorted(root.glob("P*/*/*_data.pkl")):
            name = f"{file.parent.parent.name}/{file.parent.name}"
            try:
                frames += _sequence(file, name, options, bodies)
            except InputError as error:
                left_out[name] = str(error)
        for folder in sorted(path for path in root.glob("P*/*") if path.is_dir()):
            if not any(folder.glob("*_data.pkl")):
                left_out[f"{folder.parent.name}/{folder.name}"] = f"there is no file {folder}/*_data.pkl"
        return FrameSet(tuple(frames), (), left_out)


def _sequence(file: Path, name: str, options: EmdbOptions, bodies: BodyFiles) -> list[Frame]:
    """Return the frames of a sequence, none if it is not of the part that is evaluated.

    Raises:
        DamagedFileError: the pickle is damaged, or its bodies do not project onto its own 2D joints.
        InputError: a model file is missing.
    """
    values = cached_pickle(file, file.stat().st_mtime_ns)
    if options.part != "all" and not finite_number(values, f"emdb{options.part}", file):
        return []
    count = int(finite_number(values, "n_frames", file))
    good = np.ones(count, bool)
    if "good_frames_mask" in values:
        mask = number_array(values, "good_frames_mask", file, (count,))
        good = require_finite(mask, f"{file}: 'good_frames_mask'") > 0
    numbers = np.flatnonzero(good)[:: options.every].tolist()
    frames = []
    for number in numbers:
        picture = file.parent / "images" / f"{number:05d}.jpg"
        frames.append(
            Frame(
                f"{name}/{number:05d}",
                name,
                partial(_truth, file, number, bodies),
                _camera(values, number, file),
                Picture(picture) if picture.is_file() else None,
            )
        )
    if frames and "kp2d" in values:
        _require_projection(values, numbers[0], frames[0], file)
    return frames


def _require_projection(values: dict[str, Any], number: int, frame: Frame, file: Path) -> None:
    from physic_evaluate.projection import project
    from physic_evaluate.validation import checked_truth

    joints = checked_truth(frame).people[0].joints
    assert joints is not None
    assert frame.camera is not None
    own = project(joints, frame.camera.K)
    given = number_row(values, "kp2d", file, (len(joints), 2), number)
    away = np.linalg.norm(own - given, axis=1)
    apart = float(np.nanmedian(away)) if np.isfinite(away).any() else float("inf")
    if apart > MAX_JOINT_ERROR_PX:
        raise DamagedFileError(
            f"{file}: the joints of frame {number} project {apart:.0f} px from the sequence's own 2D joints: the "
            "extrinsics are read as world to camera, and the model file as SMPL of the sequence's gender"
        )


def _truth(file: Path, number: int, bodies: BodyFiles) -> Truth:
    values = cached_pickle(file, file.stat().st_mtime_ns)
    smpl = table(values, "smpl", file)
    parameters = {
        "global_orient": number_row(smpl, "poses_root", file, (3,), number),
        "body_pose": number_row(smpl, "poses_body", file, (69,), number),
        "betas": number_array(smpl, "betas", file).reshape(-1)[:10],
        "transl": number_row(smpl, "trans", file, (3,), number),
    }
    with naming(file):
        body = bodies.smpl_body(parameters, gender_of(values, file))
    camera = _camera(values, number, file)
    person = TruePerson(
        joints=camera.in_camera(body.joints),
        joint_names=body.names,
        joint_source="posed SMPL",
        vertices=camera.in_camera(body.vertices),
        topology="smpl",
        faces=body.faces,
    )
    return Truth((person,))


def _camera(values: dict[str, Any], number: int, file: Path) -> Camera:
    record = table(values, "camera", file)
    moved = require_finite(number_row(record, "extrinsics", file, (4, 4), number), f"{file}: 'extrinsics'")
    require_rotation(moved[:3, :3], f"{file}: the rotation of 'extrinsics' of frame {number}")
    width, height = (int(finite_number(record, name, file)) for name in ("width", "height"))
    K = require_finite(number_array(record, "intrinsics", file, (3, 3)), f"{file}: 'intrinsics'")
    if not (width > 0 and height > 0 and K[0, 0] > 0 and K[1, 1] > 0):
        raise DamagedFileError(f"{file}: the camera has no positive width, height and focal lengths")
    return Camera(K, width, height, moved[:3, :3], moved[:3, 3])


DATA_SET = Emdb()
