"""PROX quantitative: one person in a scanned room, with bodies by motion capture and one Kinect
colour camera.

Get quantitative.zip from prox.is.tue.mpg.de, and SMPLX_MALE.npz from smpl-x.is.tue.mpg.de
(--smplx), each with an account and for non-commercial research. ROOT is the folder quantitative/:

    recordings/<recording>/Color/<frame>.jpg           pictures, mirrored as they come
    calibration/Color.json                             camera_mtx and k of the colour camera
    cam2world/vicon.json, vicon2scene.json             4 x 4: colour camera to scene, Vicon to scene
    scenes/vicon.ply                                   the scan
    fittings/mosh/<recording>/meshes/<frame>/000.ply   10475 vertices of SMPL-X
    fittings/mosh/<recording>/results/<frame>/000.pkl  optional: parameters, which give joints

Published readers disagree about the frame of reference of the meshes: if results are refused since
they do not project onto the people, give another --mesh-frame.

Frames are named RECORDING/FRAME; the paper's list of 178 is not published. A vertex truly touches
within 2, 4 and 5 cm of the scan, or inside it by up to 15 cm.
"""

from __future__ import annotations

from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from physic_bench.cameras import Camera
from physic_bench.data_files import (
    DamagedFrameError,
    checked_numbers,
    checked_rotation,
    missing_files,
    naming_file_in_errors,
    open_picture,
    read_json,
    read_mesh,
    read_pickled,
    read_surface,
)
from physic_bench.datasets.base import DataSet, FrameSet
from physic_bench.types import BenchPerson, Frame, Picture, Truth
from physic_core.body import JOINT_NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_bench.bodies import BodyFiles
    from physic_core.types import Float64Array


NUM_VERTICES = 10475
MAX_MODEL_ERROR_M = 0.02
"""Mean distance of a mesh from its parameters, posed by the user's file.

Another gender is 5 cm and more away.
"""

MESH_FRAMES = ("camera", "scene", "vicon")


def missing(root: Path, with_pictures: bool, mesh_frame: str) -> list[str]:
    """Return the missing files."""
    needed = [
        ("calibration/Color.json", "calibration of the color camera"),
        ("cam2world/vicon.json", "pose of the camera"),
        ("vicon2scene.json", "transform from Vicon to the scene"),
        ("scenes/vicon.ply", "scan of the scene"),
        ("fittings/mosh/*/meshes/*/000.ply", "meshes of the bodies"),
    ]
    if with_pictures:
        needed.append(("recordings/*/Color/*.jpg", "pictures"))
    return missing_files(root, needed)


def frames(
    root: Path, choose: Callable[[list[str]], list[str]], bodies: BodyFiles, mesh_frame: str
) -> FrameSet:
    """Return the frames."""
    meshes = (root / "fittings" / "mosh").glob("*/meshes/*/000.ply")
    names = choose(sorted(f"{path.parts[-4]}/{path.parts[-2]}" for path in meshes))
    pictures = {name: root / "recordings" / name.replace("/", "/Color/", 1) for name in names}
    pictures = {name: path.with_name(f"{path.name}.jpg") for name, path in pictures.items()}
    camera = _read_camera(root, [path for path in pictures.values() if path.is_file()])
    frames = [
        Frame(
            name,
            name.partition("/")[0],
            partial(_read_truth, root, name, mesh_frame, bodies),
            camera,
            Picture(pictures[name], mirrored=True) if pictures[name].is_file() else None,
        )
        for name in names
    ]
    return FrameSet(tuple(frames), (f"meshes are in the frame '{mesh_frame}'",))


def _read_truth(root: Path, name: str, kind: str, bodies: BodyFiles) -> Truth:
    vertices = _mesh_vertices(root, name)
    joints = None
    file = _fitting_file(root, name, "results/{}/000.pkl")
    if bodies.smplx is not None and file.is_file():
        with naming_file_in_errors(file):
            posed, joints = bodies.pose_smplx(read_pickled(file), "male")
        apart = float(np.linalg.norm(vertices - posed, axis=1).mean())
        if apart > MAX_MODEL_ERROR_M:
            raise DamagedFrameError(
                f"{file}, posed by {bodies.file('smplx', 'male').name}, is {1000 * apart:.0f} mm "
                "from its mesh: give --smplx SMPLX_MALE.npz, or a folder with it, since the body "
                "is male"
            )
        joints = _to_camera(root, joints, kind)
    names = () if joints is None else JOINT_NAMES
    person = BenchPerson(
        "0", joints, names, "posed SMPL-X", _to_camera(root, vertices, kind), "smplx"
    )
    return Truth((person,), scene=read_surface(root / "scenes" / "vicon.ply"))


def _fitting_file(root: Path, name: str, path: str) -> Path:
    recording, _, frame = name.partition("/")
    return root / "fittings" / "mosh" / recording / path.format(frame)


def _mesh_vertices(root: Path, name: str) -> Float64Array:
    """Return the vertices of a frame in the file's frame of reference."""
    file = _fitting_file(root, name, "meshes/{}/000.ply")
    vertices = np.asarray(read_mesh(file).vertices, np.float64)
    size = float(np.ptp(vertices, axis=0).max())
    if len(vertices) != NUM_VERTICES or not 0.2 < size < 3.0:
        raise DamagedFrameError(
            f"{file} must have {NUM_VERTICES} vertices in meters, got {len(vertices)}, {size:.3g} m"
        )
    return vertices


def _to_camera(root: Path, points: Float64Array, kind: str) -> Float64Array:
    """Return points (n, 3) of a frame of reference in the camera frame."""
    if kind == "camera":
        return points
    to_camera = np.linalg.inv(_transform(root / "cam2world" / "vicon.json"))
    if kind == "vicon":
        to_camera = to_camera @ _transform(root / "vicon2scene.json")
    moved: Float64Array = points @ to_camera[:3, :3].T + to_camera[:3, 3]
    return moved


def _read_camera(root: Path, pictures: Sequence[Path]) -> Camera:
    file = root / "calibration" / "Color.json"
    with naming_file_in_errors(file):
        record = read_json(file)
        K = checked_numbers(record["camera_mtx"], (3, 3), "camera_mtx")
        k1, k2, p1, p2, k3 = (float(v) for v in checked_numbers(record["k"], (-1,), "k")[:5])
    size = (1920, 1080)
    if pictures:
        with open_picture(pictures[0]) as opened:
            size = opened.size
    to_camera = np.asarray(np.linalg.inv(_transform(root / "cam2world" / "vicon.json")), np.float64)
    return Camera(K, *size, to_camera[:3, :3], to_camera[:3, 3], (k1, k2, p1, p2, k3))


@lru_cache(maxsize=8)
def _transform(file: Path) -> Float64Array:
    """Return a rigid transform (4, 4) in metres."""
    with naming_file_in_errors(file):
        matrix = checked_numbers(read_json(file), (4, 4), "transform")
        checked_rotation(matrix[:3, :3], "transform")
    return matrix


DATA_SET = DataSet(
    "prox",
    __doc__,
    missing,
    frames,
    (
        click.Option(
            ["--mesh-frame"],
            type=click.Choice(MESH_FRAMES),
            default="vicon",
            show_default=True,
            help="Frame of reference of the meshes.",
        ),
    ),
)
