"""RICH: one or two people in scanned places before several cameras, with annotated contact.

Get bodies, human_scene_contact, images and scan_calibration of a split from rich.is.tue.mpg.de,
SMPLX_{NEUTRAL,MALE,FEMALE}.npz from smpl-x.is.tue.mpg.de (--smplx FOLDER), each with an account and
for non-commercial research, and resource/gender.json from the repository rich_toolkit of
paulchhuang. Files of ROOT:

    bodies/<split>/<SEQ>/<FRAME>/<SUB>.pkl                SMPL-X parameters in the frame of camera 0
    human_scene_contact/<split>/<SEQ>/<FRAME>/<SUB>.pkl   'contact' (6890,)
    images/<split>/<SEQ>/cam_<XX>/<FRAME>_<XX>.jpeg       or .png, .bmp
    scan_calibration/<SCENE>/calibration/<CAM>.xml        CameraMatrix, Intrinsics, Distortion
    scan_calibration/<SCENE>/scan_camcoord.ply            optional: scan in the frame of camera 0
    resource/gender.json                                  gender of each subject

Frames are named SEQ/FRAME/CAMERA. Predicted contact of another mesh than that of 6890 vertices is
carried over, which needs --smpl. Cameras without calibration are skipped.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import click

from physic_bench.cameras import Camera
from physic_bench.data_files import (
    DamagedFrameError,
    checked_numbers,
    checked_rotation,
    missing_files,
    naming_file_in_errors,
    open_picture,
    read_json,
    read_pickled,
    read_surface,
)
from physic_bench.datasets.base import DataSet, FrameSet
from physic_bench.types import BenchPerson, Frame, Picture, Truth
from physic_core.body import JOINT_NAMES
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_bench.bodies import BodyFiles


def missing(root: Path, with_pictures: bool, split: str) -> list[str]:
    """Return the missing files."""
    needed = [
        (f"bodies/{split}/*/*/*.pkl", "bodies"),
        ("scan_calibration/*/calibration/*.xml", "calibration of the cameras"),
        ("resource/gender.json", "gender of the subjects, from rich_toolkit"),
        (f"human_scene_contact/{split}/*/*/*.pkl", "annotated contact"),
    ]
    return missing_files(root, needed + [(f"images/{split}/*/cam_*/*", "pictures")] * with_pictures)


def frames(
    root: Path, choose: Callable[[list[str]], list[str]], bodies: BodyFiles, split: str
) -> FrameSet:
    """Return the frames."""
    if bodies.smplx is None:
        raise ConfigError(
            "RICH holds parameters of SMPL-X: give --smplx FOLDER with SMPLX_MALE and SMPLX_FEMALE"
        )
    names = [
        f"{folder.parent.name}/{folder.name}/{int(file.stem)}"
        for folder in sorted((root / "bodies" / split).glob("*/*"))
        for file in sorted((_scene_file(root, folder.parent.name) / "calibration").glob("*.xml"))
        if file.stem.isdecimal()
    ]
    with_picture = [name for name in names if _picture(root, split, name) is not None]
    frames = []
    left_out = {}
    for name in choose(with_picture or names):
        sequence, moment, view = name.split("/")
        picture = _picture(root, split, name)
        try:
            camera = _read_camera(
                _scene_file(root, sequence) / "calibration" / f"{int(view):03d}.xml", picture
            )
        except DamagedFrameError as error:
            left_out[name] = str(error)
            continue
        load = partial(_read_truth, root, sequence, moment, camera, split, bodies)
        frame_picture = None if picture is None else Picture(picture)
        frames.append(Frame(name, sequence, load, camera, frame_picture, f"{sequence}/{moment}"))
    return FrameSet(tuple(frames), (), left_out)


def _read_truth(
    root: Path, sequence: str, moment: str, camera: Camera, split: str, bodies: BodyFiles
) -> Truth:
    genders = read_json(root / "resource" / "gender.json")
    people = []
    for file in sorted((root / "bodies" / split / sequence / moment).glob("*.pkl")):
        with naming_file_in_errors(root / "resource" / "gender.json"):
            gender = genders.get(file.stem) or genders[file.stem.lstrip("0")]
        with naming_file_in_errors(file):
            vertices, joints = bodies.pose_smplx(read_pickled(file), gender)
        labels = root / "human_scene_contact" / split / sequence / moment / file.name
        with naming_file_in_errors(labels):
            contact = checked_numbers(read_pickled(labels)["contact"], (6890,), "contact") > 0
        joints = camera.to_camera(joints)
        vertices = camera.to_camera(vertices)
        people.append(
            BenchPerson(
                file.stem, joints, JOINT_NAMES, "posed SMPL-X", vertices, "smplx", contact, "smpl"
            )
        )
    scan = _scene_file(root, sequence) / "scan_camcoord.ply"
    return Truth(tuple(people), scene=read_surface(scan) if scan.is_file() else None)


def _read_camera(file: Path, picture: Path | None) -> Camera:
    with naming_file_in_errors(file):
        values = {
            name: checked_numbers([float(part) for part in node.text.split()], (-1,), name)  # type: ignore[union-attr]
            for name in ("Intrinsics", "CameraMatrix", "Distortion")
            if (node := ElementTree.parse(file).find(f"./{name}/data")) is not None
        }
        K = checked_numbers(values["Intrinsics"], (3, 3), "Intrinsics").copy()
        to_camera = checked_numbers(values["CameraMatrix"], (3, 4), "CameraMatrix")
        R = checked_rotation(to_camera[:, :3], "CameraMatrix")
        t = to_camera[:, 3]
        k1, k2 = values["Distortion"][:2]
        if K[[0, 1, 0, 1], [0, 1, 2, 2]].min() <= 0:
            raise DamagedFrameError("the camera must have a focal length and a principal point")
    width = round(2 * K[0, 2])
    height = round(2 * K[1, 2])
    if picture is not None:
        with open_picture(picture) as opened:
            size = opened.size
        # Pictures may have been made smaller by a half or a quarter: the calibration is for the
        # full ones.
        factor = 2.0 ** round(math.log2(size[0] / width))
        if not all(
            0.8 < factor * full / side < 1.25
            for side, full in zip(size, (width, height), strict=True)
        ):
            raise DamagedFrameError(
                f"the picture {picture} has {size} px, and {file} is for {width} x {height}"
            )
        K[:2] *= factor
        width, height = size
    return Camera(K, width, height, R, t, (float(k1), float(k2), 0.0, 0.0, 0.0))


def _scene_file(root: Path, sequence: str) -> Path:
    """Return the folder of the scene: the first word of the sequence, with its variant where there
    are several.
    """
    first = sequence.split("_")[0]
    folders = sorted(
        path for path in (root / "scan_calibration").glob(f"{first}_*") if path.is_dir()
    )
    return next(
        (path for path in folders if path.name.removeprefix(f"{first}_") in sequence),
        root / "scan_calibration" / first,
    )


def _picture(root: Path, split: str, name: str) -> Path | None:
    sequence, moment, view = name.split("/")
    stem = f"{split}/{sequence}/cam_{int(view):02d}/{moment}_{int(view):02d}"
    paths = (
        root / top / f"{stem}.{s}"
        for top in ("images", "images_jpg_subset")
        for s in ("jpeg", "jpg", "png", "bmp")
    )
    return next((path for path in paths if path.is_file()), None)


_SPLIT = click.Option(
    ["--split"], type=click.Choice(["train", "val", "test"]), default="test", show_default=True
)

DATA_SET = DataSet("rich", __doc__, missing, frames, (_SPLIT,))
