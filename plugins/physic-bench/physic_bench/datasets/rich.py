"""RICH: SMPL-X bodies of several static cameras in scanned places, with annotated contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar
from xml.etree import ElementTree

import numpy as np

from physic_bench.cameras import Camera
from physic_bench.contract import Frame, Picture, Surface, TruePerson, Truth
from physic_bench.damage import (
    GENDERS,
    DamagedFrameError,
    damaged_file_error,
    naming,
    number_array,
    require_finite,
    require_rotation,
)
from physic_bench.datasets.base import (
    DataSet,
    DataSource,
    Description,
    FrameSet,
    evenly,
    listed_frames,
    missing_dataset_files,
    option,
    read_json,
)
from physic_bench.meshes import read_scene_mesh, read_vertex_colours
from physic_bench.pickled import pickled_arrays
from physic_bench.pictures import open_picture
from physic_core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from physic_bench.bodies import BodyFiles

    Array = NDArray[np.float64]

MAX_RANGE_M = 100.0
"""From camera 0 to another one."""

GREEN = (0, 255, 0, 255)
SUFFIXES = ("jpeg", "jpg", "png", "bmp")

TREE = """\
ROOT/
  bodies/<split>/<SEQ>/<FRAME:05d>/<SUB>.pkl                 SMPL-X parameters in the frame of camera 0
  human_scene_contact/<split>/<SEQ>/<FRAME:05d>/<SUB>.pkl    'contact' (6890,); <SUB>.obj: 10475 vertices, contact green
  images/<split>/<SEQ>/cam_<XX>/<FRAME:05d>_<XX>.<bmp|png|jpeg>
  scan_calibration/<SCENE>/calibration/<cam:03d>.xml         CameraMatrix, Intrinsics, Distortion
  scan_calibration/<SCENE>/scan_camcoord.ply                 scan in the frame of camera 0
  resource/gender.json                                       gender of each subject"""


@dataclass(frozen=True)
class RichOptions:
    """Options of the command.

    Attributes:
        split: "train", "val" or "test".
        frames: file with one SEQ/FRAME/CAMERA per line.
    """

    split: str = option("test", "train, val or test.", metavar="NAME")
    frames: str = option("", "Text file with one SEQ/FRAME/CAMERA per line: the pictures to evaluate.", metavar="FILE")


class Rich(DataSet):
    """Reads bodies, contacts, scans and calibrations."""

    name: ClassVar[str] = "rich"
    summary: ClassVar[str] = "RICH"
    Options: ClassVar[type[Any]] = RichOptions

    def describe(self) -> Description:
        """Return what RICH needs."""
        return Description(
            "RICH: one or two people in scanned places before several cameras, with annotated contact.",
            (
                DataSource(
                    "bodies, human_scene_contact, images, scan_calibration of a split",
                    "the site of RICH, rich.is.tue.mpg.de, with an account",
                    "RICH licence: non-commercial research",
                ),
                DataSource("resource/gender.json", "the repository rich_toolkit of paulchhuang", "its licence"),
                DataSource(
                    "SMPL-X model files SMPLX_{NEUTRAL,MALE,FEMALE}.npz (--smplx FOLDER)",
                    "the site of SMPL-X, smpl-x.is.tue.mpg.de, with an account",
                    "SMPL-X licence: non-commercial research",
                ),
            ),
            TREE,
            (
                "The paper evaluates 100 pictures; their list is that of the results that its first author published "
                "(--frames).",
                "Bodies are posed by the file of the subject's gender, hands from 12 principal components.",
                "Contact of 6890 vertices (.pkl) is the truth as published, that of 10475 (.obj) where it is missing; "
                "predicted contact of another mesh is carried over, which needs --smpl.",
                "Pictures are undistorted by the two radial coefficients. Cameras without calibration are skipped.",
            ),
        )

    def check(self, root: Path, options: RichOptions, *, pictures: bool = True) -> list[str]:
        """Return the missing files."""
        split = options.split
        needed = [
            (f"bodies/{split}/*/*/*.pkl", "bodies"),
            ("scan_calibration/*/calibration/*.xml", "calibration of the cameras"),
            ("resource/gender.json", "gender of the subjects, from rich_toolkit"),
            (f"human_scene_contact/{split}/*/*/*.*", "annotated contact"),
        ]
        if pictures:
            needed.append((f"images/{split}/*/cam_*/*", "pictures"))
        return missing_dataset_files(root, needed)

    def frames(self, root: Path, options: RichOptions, bodies: BodyFiles, limit: int | None = None) -> FrameSet:
        """Return the pictures."""
        if not bodies.has("smplx"):
            raise InputError("RICH holds parameters of SMPL-X: give --smplx FOLDER with SMPLX_MALE and SMPLX_FEMALE")
        names = evenly(listed_frames(options.frames) if options.frames else _all(root, options.split), limit)
        frames = []
        left_out = {} if options.frames else dict(_without_views(root, options.split))
        for name in names:
            try:
                frames.append(_frame(root, name, options, bodies))
            except InputError as error:
                left_out[name] = str(error)
        return FrameSet(tuple(frames), (), left_out)


def _frame(root: Path, name: str, options: RichOptions, bodies: BodyFiles) -> Frame:
    """Return the frame of a name SEQ/FRAME/CAMERA.

    Raises:
        InputError: it has no body or no calibration.
    """
    parts = name.split("/")
    if len(parts) != 3 or not parts[2].isdecimal():
        raise InputError(f"'{name}' is not SEQ/FRAME/CAMERA, such as Gym_010_pushup1/00150/2")
    sequence, number, view = parts[0], parts[1], int(parts[2])
    folder = root / "bodies" / options.split / sequence / number
    if not any(folder.glob("*.pkl")):
        raise InputError(f"there is no body in {folder}")
    picture = _picture(root, options.split, sequence, number, view)
    camera = _camera(root, _scene_name(root, sequence), view, picture)
    action = sequence.split("_")[-1].rstrip("0123456789")
    load = partial(_truth, root, sequence, number, camera, options, bodies)
    return Frame(
        name, sequence, load, camera, Picture(picture) if picture else None, {"action": action}, f"{sequence}/{number}"
    )


def _truth(root: Path, sequence: str, number: str, camera: Camera, options: RichOptions, bodies: BodyFiles) -> Truth:
    genders = _genders(root / "resource" / "gender.json")
    people = []
    for file in sorted((root / "bodies" / options.split / sequence / number).glob("*.pkl")):
        gender = genders.get(str(int(file.stem)) if file.stem.isdecimal() else file.stem)
        if gender is None:
            raise DamagedFrameError(f"{root / 'resource' / 'gender.json'} has no subject {file.stem}")
        with naming(file):
            body = bodies.smplx_body(pickled_arrays(file), gender)
        contact, mesh = _contact(root, file, sequence, number, options)
        people.append(
            TruePerson(
                file.stem,
                joints=camera.in_camera(body.joints),
                joint_names=body.names,
                joint_source="posed SMPL-X",
                vertices=camera.in_camera(body.vertices),
                topology="smplx",
                faces=body.faces,
                contact=contact,
                contact_topology=mesh,
            )
        )
    return Truth(tuple(people), scene=_scan(root / "scan_calibration" / _scene_name(root, sequence)))


@lru_cache(maxsize=2)
def _genders(file: Path) -> dict[str, str]:
    """Return subject (without leading zeros) -> gender.

    Raises:
        DamagedFrameError: the file has another content.
    """
    found = read_json(file)
    if not isinstance(found, dict) or not all(value in GENDERS for value in found.values()):
        raise DamagedFrameError(f"{file} must be an object of subjects, each of them one of {', '.join(GENDERS)}")
    return {str(int(key)) if key.isdecimal() else key: value for key, value in found.items()}


def _contact(root: Path, body: Path, sequence: str, number: str, options: RichOptions) -> tuple[NDArray[np.bool_], str]:
    """Return the annotated contact of a person and its mesh: of the .pkl file, or of the .obj file without it.

    Raises:
        DamagedFrameError: the person has neither file, or it has another content.
    """
    file = root / "human_scene_contact" / options.split / sequence / number / body.name
    mesh, wanted = "smpl", 6890
    if file.is_file():
        values = number_array(pickled_arrays(file), "contact", file).reshape(-1)
        found = require_finite(values, f"{file}: 'contact'") > 0
    else:
        mesh, wanted, file = "smplx", 10475, file.with_suffix(".obj")
        found = (read_vertex_colours(file) == GREEN).all(1)
    if len(found) != wanted:
        raise DamagedFrameError(f"{file} has contact of {len(found)} vertices, where {mesh.upper()} has {wanted}")
    return found, mesh


@lru_cache(maxsize=3)
def _scan(folder: Path) -> Surface | None:
    file = folder / "scan_camcoord.ply"
    return read_scene_mesh(file) if file.is_file() else None


def _camera(root: Path, scene: str, view: int, picture: Path | None) -> Camera:
    file = root / "scan_calibration" / scene / "calibration" / f"{view:03d}.xml"
    if not file.is_file():
        raise DamagedFrameError(f"camera {view} of {scene} has no calibration: there is no file {file}")
    K, extrinsics = _matrix(file, "Intrinsics", (3, 3)), _matrix(file, "CameraMatrix", (3, 4))
    lens = _matrix(file, "Distortion", None)
    if len(lens) < 2:
        raise DamagedFrameError(f"{file}: Distortion must have 2 numbers or more, got {len(lens)}")
    k1, k2 = lens[:2]
    rotation = require_rotation(extrinsics[:, :3], f"{file}: the rotation of CameraMatrix")
    if np.abs(extrinsics[:, 3]).max() > MAX_RANGE_M:
        raise DamagedFrameError(f"{file}: the camera is {np.abs(extrinsics[:, 3]).max():.0f} m away: it must be metres")
    width, height = round(2 * K[0, 2]), round(2 * K[1, 2])
    if not (K[0, 0] > 0 and K[1, 1] > 0 and width > 0 and height > 0):
        raise DamagedFrameError(f"{file}: Intrinsics has no positive focal lengths and principal point")
    if picture is not None:
        with open_picture(picture) as opened:
            size = opened.size
        # Pictures may have been made smaller by a half or a quarter: the calibration is for the full ones.
        factor = 2.0 ** round(math.log2(size[0] / width))
        if not all(0.8 < factor * full / own < 1.25 for own, full in zip(size, (width, height), strict=True)):
            raise DamagedFrameError(
                f"the picture {picture} has {size[0]} x {size[1]} px, but the principal point of {file} is the middle "
                f"of {width} x {height} px: a picture has that size, or a half or a quarter of it"
            )
        K = K.copy()
        K[:2] *= factor
        width, height = size
    return Camera(K, width, height, rotation, extrinsics[:, 3], (float(k1), float(k2), 0.0, 0.0, 0.0))


def _matrix(file: Path, name: str, shape: tuple[int, int] | None) -> Array:
    try:
        node = ElementTree.parse(file).find(f"./{name}/data")
    except OSError as error:
        raise damaged_file_error(file, error) from error
    except (ElementTree.ParseError, ValueError) as error:
        raise DamagedFrameError(f"{file} is not valid XML: it is damaged or truncated") from error
    if node is None or not node.text:
        raise DamagedFrameError(f"{file} has no {name}/data")
    try:
        values = np.array([float(part) for part in node.text.split()])
    except ValueError as error:
        raise DamagedFrameError(f"{file}: {name} holds no numbers") from error
    require_finite(values, f"{file}: {name}")
    if shape is not None and values.size != shape[0] * shape[1]:
        raise DamagedFrameError(f"{file}: {name} must have {shape[0]} x {shape[1]} numbers, got {values.size}")
    found: Array = values if shape is None else values.reshape(shape)
    return found


def _scene_name(root: Path, sequence: str) -> str:
    """Return the folder of the scene: the first word of the sequence, with its variant where there are several."""
    first = sequence.split("_")[0]
    folders = sorted(path.name for path in (root / "scan_calibration").glob(f"{first}*") if path.is_dir())
    for name in folders:
        if name != first and name.removeprefix(f"{first}_") in sequence:
            return name
    return first


def _all(root: Path, split: str) -> list[str]:
    """Return SEQ/FRAME/CAMERA for every body and calibrated camera that has a picture, or for all without pictures."""
    names = []
    for folder in sorted((root / "bodies" / split).glob("*/*")):
        sequence, number = folder.parent.name, folder.name
        calibrated = (root / "scan_calibration" / _scene_name(root, sequence) / "calibration").glob("*.xml")
        views = sorted(int(path.stem) for path in calibrated if path.stem.isdecimal())
        shown = [v for v in views if _picture(root, split, sequence, number, v) is not None]
        names += [f"{sequence}/{number}/{view}" for view in (shown or views)]
    return names


def _without_views(root: Path, split: str) -> Iterator[tuple[str, str]]:
    """Yield the sequences and frames that give no picture, with the reason."""
    for folder in sorted(path for path in (root / "bodies" / split).glob("*") if path.is_dir()):
        frames = sorted(path for path in folder.glob("*") if path.is_dir())
        if not frames:
            yield folder.name, f"there is no frame in {folder}"
        calibration = root / "scan_calibration" / _scene_name(root, folder.name) / "calibration"
        if frames and not any(path.stem.isdecimal() for path in calibration.glob("*.xml")):
            yield folder.name, f"there is no calibration of a camera in {calibration}"


def _picture(root: Path, split: str, sequence: str, number: str, view: int) -> Path | None:
    for top in ("images", "images_jpg_subset"):
        folder = root / top / split / sequence / f"cam_{view:02d}"
        for suffix in SUFFIXES:
            path = folder / f"{number}_{view:02d}.{suffix}"
            if path.is_file():
                return path
    return None


DATA_SET = Rich()
