"""PROX quantitative: bodies by motion capture in one scanned room, one Kinect colour camera."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_bench.cameras import Camera
from physic_bench.contract import Frame, Picture, Surface, TruePerson, Truth
from physic_bench.damage import (
    DamagedFrameError,
    as_numbers,
    item,
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
from physic_bench.meshes import read_mesh, read_scene_mesh, require_metres
from physic_bench.pickled import pickled_arrays
from physic_bench.pictures import open_picture
from physic_bench.projection import box_of_points, project
from physic_bench.wording import counted
from physic_core.adapters.detections import box_iou
from physic_core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from physic_bench.bodies import BodyFiles

    Array = NDArray[np.float64]

SIZE = (1920, 1080)
NUM_VERTICES = 10475
MIN_OVERLAP, MIN_LEAD = 0.4, 0.1
"""Of the frame of reference that fits: median overlap of boxes, and by how much it is ahead of the others."""

MAX_MODEL_ERROR_M = 0.02
"""Mean distance of a mesh from its parameters, posed by the user's file. Another gender is 5 cm and more away."""

MESH_FRAMES = ("camera", "scene", "vicon")

TREE = """\
ROOT/                                          (the folder quantitative/)
  recordings/<recording>/Color/<frame>.jpg     pictures, mirrored as they come
  calibration/Color.json                       camera_mtx, k of the colour camera
  cam2world/vicon.json                         4 x 4, colour camera to scene
  vicon2scene.json                             4 x 4, Vicon to scene
  scenes/vicon.ply                             the scan
  fittings/mosh/<recording>/meshes/<frame>/000.ply     10475 vertices of SMPL-X
  fittings/mosh/<recording>/results/<frame>/000.pkl    parameters (optional: joints, with --smplx)
  keypoints/<recording>/<frame>_keypoints.json         OpenPose (optional: decides in which frame the meshes are)"""


@dataclass(frozen=True)
class ProxOptions:
    """Options of the command.

    Attributes:
        frames: file with one RECORDING/FRAME per line.
        mesh_frame: frame of reference of the meshes; "auto" decides by the keypoints.
    """

    frames: str = option("", "Text file with one RECORDING/FRAME per line: the frames to evaluate.", metavar="FILE")
    mesh_frame: str = option("auto", "Frame of the meshes: auto, camera, scene or vicon.", metavar="NAME")


class Prox(DataSet):
    """Reads the quantitative set."""

    name: ClassVar[str] = "prox"
    summary: ClassVar[str] = "PROX quantitative"
    Options: ClassVar[type[Any]] = ProxOptions

    def describe(self) -> Description:
        """Return what PROX quantitative needs."""
        return Description(
            "PROX quantitative: one person in a scanned room, with bodies by motion capture.",
            (
                DataSource(
                    "quantitative.zip",
                    "the site of PROX, prox.is.tue.mpg.de, with an account",
                    "PROX licence: non-commercial research",
                ),
                DataSource(
                    "SMPL-X model file SMPLX_MALE.npz (for joints, and to carry contact to other bodies)",
                    "the site of SMPL-X, smpl-x.is.tue.mpg.de, with an account",
                    "SMPL-X licence: non-commercial research",
                ),
            ),
            TREE,
            (
                "The paper evaluates 178 frames, and PROX's README names 180; the list is not published: give your own "
                "with --frames, or take some with --limit.",
                "Pictures are mirrored before use, and undistorted by k of Color.json.",
                "MPVPE needs the meshes alone. Joints are those of the parameters, posed by SMPLX_MALE.npz (--smplx), "
                "or the joint regressor on the meshes, which the table calls an approximation.",
                "Whether the meshes are in the frame of the camera, the scene or Vicon is decided by projection onto "
                "the keypoints, and printed. Where none fits, nothing is evaluated.",
                "Contact truth is not shipped: a vertex touches within 2, 4 and 5 cm of the scan, or inside it by up "
                "to 15 cm.",
            ),
        )

    def check(self, root: Path, options: ProxOptions, *, pictures: bool = True) -> list[str]:
        """Return the missing files, and the listed frames that do not exist."""
        needed = [
            ("calibration/Color.json", "calibration of the colour camera"),
            ("cam2world/vicon.json", "pose of the camera"),
            ("vicon2scene.json", "transform from Vicon to the scene"),
            ("scenes/vicon.ply", "scan of the scene, for contact and penetration"),
            ("fittings/mosh/*/meshes/*/000.ply", "meshes of the bodies"),
        ]
        if pictures:
            needed.append(("recordings/*/Color/*.jpg", "pictures"))
        missing = missing_dataset_files(root, needed)
        if options.mesh_frame not in ("auto", *MESH_FRAMES):
            missing.append(f"--mesh-frame is one of auto, {', '.join(MESH_FRAMES)} (got '{options.mesh_frame}')")
        if options.mesh_frame == "auto" and next(root.glob("keypoints/*/*_keypoints.json"), None) is None:
            missing.append(
                f"{root / 'keypoints/*/*_keypoints.json'}: keypoints that decide in which frame the meshes are; or "
                "give --mesh-frame"
            )
        if options.frames and not missing:
            missing += [f"{name}: listed in {options.frames}" for name in _not_there(root, options)]
        return missing

    def frames(self, root: Path, options: ProxOptions, bodies: BodyFiles, limit: int | None = None) -> FrameSet:
        """Return the frames, after the decision about the meshes and the check of the model file."""
        names = evenly(_listed(options) if options.frames else _all(root), limit)
        camera = _camera(root)
        chosen, note = options.mesh_frame, f"meshes are in the frame '{options.mesh_frame}', as you chose"
        if chosen == "auto":
            chosen, note = decide_mesh_frame(root, names, camera)
        notes = [note, _model_note(root, names, bodies, chosen)]
        frames = []
        for name in names:
            recording, _, frame = name.partition("/")
            picture = root / "recordings" / recording / "Color" / f"{frame}.jpg"
            load = partial(_truth, root, name, chosen, bodies)
            frames.append(
                Frame(name, recording, load, camera, Picture(picture, mirrored=True) if picture.is_file() else None)
            )
        left_out = {} if options.frames else _without_mesh(root)
        return FrameSet(tuple(frames), tuple(notes), left_out)


def decide_mesh_frame(root: Path, names: list[str], camera: Camera) -> tuple[str, str]:
    """Return the frame of reference of the meshes, and a sentence about the decision.

    Each mesh of up to ten frames is projected as if it were in each frame of reference; the boxes are compared with
    those of the keypoints, as they are and mirrored.

    Raises:
        InputError: none fits, or two fit alike.
    """
    found: dict[tuple[str, bool], list[float]] = {}
    count, reason = 0, ""
    for name in names[:: max(len(names) // 10, 1)][:10]:
        try:
            keypoints, vertices = _keypoints(root, name), _mesh(root, name).vertices
        except DamagedFrameError as error:
            reason = reason or f" ({error})"
            continue  # the frame is skipped with this reason when it is scored
        if keypoints is None or box_of_points(keypoints) is None:
            continue
        count += 1
        for kind in MESH_FRAMES:
            own = box_of_points(project(_to_camera(root, vertices, kind), camera.K))
            for mirrored in (False, True):
                points = keypoints * [-1, 1] + [camera.width - 1, 0] if mirrored else keypoints
                box = box_of_points(points)
                iou = 0.0 if own is None or box is None else float(box_iou(own[None], box[None])[0, 0])
                found.setdefault((kind, mirrored), []).append(iou)
    if not count:
        raise InputError(f"no frame of {root} has both a mesh and keypoints{reason}: give --mesh-frame")
    overlap = {kind: max(median(found[kind, False]), median(found[kind, True])) for kind in MESH_FRAMES}
    ranked = sorted(overlap, key=lambda kind: -overlap[kind])
    numbers = ", ".join(f"{kind} {overlap[kind]:.2f}" for kind in MESH_FRAMES)
    if overlap[ranked[0]] < MIN_OVERLAP or overlap[ranked[0]] - overlap[ranked[1]] < MIN_LEAD:
        why = "none fits" if overlap[ranked[0]] < MIN_OVERLAP else "two fit alike"
        raise InputError(
            f"it cannot be decided in which frame the meshes of {root} are: {why} (median overlap of the projected "
            f"mesh with the keypoints over {counted(count, 'frame')}: {numbers}). Check calibration/Color.json, "
            "cam2world/vicon.json and vicon2scene.json, or give --mesh-frame"
        )
    kind = ranked[0]
    mirrored = median(found[kind, True]) > median(found[kind, False])
    return kind, (
        f"meshes are in the frame '{kind}': median overlap with the keypoints{' (mirrored)' if mirrored else ''} over "
        f"{counted(count, 'frame')}: {numbers}"
    )


def _truth(root: Path, name: str, kind: str, bodies: BodyFiles) -> Truth:
    mesh = _mesh(root, name)
    joints, names, source = _joints(root, name, mesh.vertices, bodies, kind)
    person = TruePerson(
        joints=joints,
        joint_names=names,
        joint_source=source,
        vertices=_to_camera(root, mesh.vertices, kind),
        topology="smplx",
        faces=mesh.faces,
    )
    return Truth((person,), scene=_scene(root))


@lru_cache(maxsize=2)
def _scene(root: Path) -> Surface:
    return read_scene_mesh(root / "scenes" / "vicon.ply")


def _joints(
    root: Path, name: str, vertices: Array, bodies: BodyFiles, kind: str
) -> tuple[Array | None, tuple[str, ...], str]:
    """Return joints in the camera frame, their names, and where they come from."""
    if not bodies.has("smplx"):
        return None, (), ""
    file = _parameter_file(root, name)
    if file.is_file():
        # Parameters are in the frame of the meshes, which _model_note has checked.
        with naming(file):
            body = bodies.smplx_body(pickled_arrays(file), "male")
        return _to_camera(root, body.joints, kind), body.names, "posed SMPL-X"
    found = bodies.regressed_joints(vertices, "smplx", "male")
    if found is None:
        return None, (), ""
    return _to_camera(root, found[0], kind), found[1], "approximation: joint regressor on the mesh"


def _model_note(root: Path, names: list[str], bodies: BodyFiles, kind: str) -> str:
    """Compare one mesh with its parameters, posed by the user's file.

    Raises:
        InputError: they differ by more than rounding: a file of another gender, or another frame of reference.
    """
    if not bodies.has("smplx"):
        return "no joints: they need the SMPL-X model file (--smplx)"
    damaged = ""
    for name in names:
        file = _parameter_file(root, name)
        if not file.is_file():
            continue
        try:
            mesh = _mesh(root, name).vertices
            with naming(file):
                body = bodies.smplx_body(pickled_arrays(file), "male")
        except DamagedFrameError as error:
            damaged = damaged or str(error)
            continue  # the frame is skipped with this reason when it is scored
        apart = float(np.linalg.norm(mesh - body.vertices, axis=1).mean())
        if apart > MAX_MODEL_ERROR_M:
            raise InputError(
                f"the parameters of {name}, posed by {bodies.file('smplx', 'male').name}, are {1000 * apart:.0f} mm "
                "from its mesh: the body is male, and mesh and parameters are in one frame; give --smplx a folder with "
                "SMPLX_MALE.npz, or that file"
            )
        return f"joints are posed by {bodies.file('smplx', 'male').name}, {1000 * apart:.1f} mm from the mesh"
    if damaged:
        return f"joints are not checked: no frame has both a mesh and parameters that can be read; the first: {damaged}"
    return "joints are an approximation: the joint regressor on the meshes, since there are no parameters"


def _all(root: Path) -> list[str]:
    return sorted(
        f"{path.parts[-4]}/{path.parts[-2]}" for path in (root / "fittings" / "mosh").glob("*/meshes/*/000.ply")
    )


def _without_mesh(root: Path) -> dict[str, str]:
    """Return the frames that have a folder of parameters or meshes, but no mesh, with the reason."""
    folders = sorted((root / "fittings" / "mosh").glob("*/*/*/"))
    names = [f"{path.parts[-3]}/{path.parts[-1]}" for path in folders if path.parts[-2] in ("meshes", "results")]
    return {
        name: f"there is no mesh {_mesh_file(root, name)}" for name in names if not _mesh_file(root, name).is_file()
    }


def _listed(options: ProxOptions) -> list[str]:
    return [name.removesuffix(".jpg") for name in listed_frames(options.frames)]


def _not_there(root: Path, options: ProxOptions) -> Iterator[str]:
    for name in _listed(options):
        if not _mesh_file(root, name).is_file():
            yield str(_mesh_file(root, name))


def _mesh(root: Path, name: str) -> Surface:
    """Return the mesh of a frame in the file's frame of reference.

    Raises:
        DamagedFrameError: it is damaged, no SMPL-X mesh, or not in metres.
    """
    mesh = read_mesh(_mesh_file(root, name))
    if len(mesh.vertices) != NUM_VERTICES:
        raise DamagedFrameError(
            f"{_mesh_file(root, name)} has {len(mesh.vertices)} vertices, where SMPL-X has {NUM_VERTICES}"
            f"{' (6890 is SMPL)' if len(mesh.vertices) == 6890 else ''}"
        )
    require_metres(mesh.vertices, _mesh_file(root, name))
    return mesh


def _mesh_file(root: Path, name: str) -> Path:
    recording, _, frame = name.partition("/")
    return root / "fittings" / "mosh" / recording / "meshes" / frame / "000.ply"


def _parameter_file(root: Path, name: str) -> Path:
    recording, _, frame = name.partition("/")
    return root / "fittings" / "mosh" / recording / "results" / frame / "000.pkl"


def _keypoints(root: Path, name: str) -> Array | None:
    """Return the confident keypoints (n, 2) px of the first person of OpenPose; None without.

    Raises:
        DamagedFrameError: the file has another content.
    """
    recording, _, frame = name.partition("/")
    file = root / "keypoints" / recording / f"{frame}_keypoints.json"
    if not file.is_file():
        return None
    document = read_json(file)
    people = item(document, "people", file) if isinstance(document, dict) else None
    if not isinstance(people, list) or not all(isinstance(person, dict) for person in people):
        raise DamagedFrameError(f"{file} has no list of 'people'")
    if not people:
        return None
    points = number_array(people[0], "pose_keypoints_2d", file, (-1, 3))
    found: Array = points[points[:, 2] > 0.2, :2]
    return found if len(found) >= 5 else None


def _to_camera(root: Path, points: Array, kind: str) -> Array:
    """Return points (n, 3) of a frame of reference in the camera frame."""
    if kind == "camera":
        return points
    to_camera = np.linalg.inv(_transform(root / "cam2world" / "vicon.json"))
    if kind == "vicon":
        to_camera = to_camera @ _transform(root / "vicon2scene.json")
    moved: Array = points @ to_camera[:3, :3].T + to_camera[:3, 3]
    return moved


def _camera(root: Path) -> Camera:
    file = root / "calibration" / "Color.json"
    record = read_json(file)
    if not isinstance(record, dict) or "camera_mtx" not in record:
        raise DamagedFrameError(f"{file} has no 'camera_mtx' of 3 x 3 numbers")
    K = require_finite(number_array(record, "camera_mtx", file, (3, 3)), f"{file}: 'camera_mtx'")
    if not (K[0, 0] > 0 and K[1, 1] > 0):
        raise DamagedFrameError(f"{file}: 'camera_mtx' has focal lengths {K[0, 0]:g} and {K[1, 1]:g} px")
    lens = [
        float(v) for v in require_finite(as_numbers(record.get("k", [0.0] * 5), f"{file}: 'k'"), f"{file}: 'k'").ravel()
    ]
    lens = lens[:5]
    k1, k2, p1, p2, k3 = [*lens, *[0.0] * (5 - len(lens))]
    to_camera = np.asarray(np.linalg.inv(_transform(root / "cam2world" / "vicon.json")), np.float64)
    return Camera(K, *_size(root), to_camera[:3, :3], to_camera[:3, 3], (k1, k2, p1, p2, k3))


def _size(root: Path) -> tuple[int, int]:
    """Return the size of the first picture that can be read, px; that of PROX's camera without one."""
    for picture in root.glob("recordings/*/Color/*.jpg"):
        with suppress(DamagedFrameError), open_picture(picture) as file:
            size: tuple[int, int] = file.size
            return size
    return SIZE


@lru_cache(maxsize=8)
def _transform(path: Path) -> Array:
    """Return a rigid transform (4, 4).

    Raises:
        DamagedFrameError: it is not rigid: scaled (millimetres), or a mirror image.
    """
    matrix = as_numbers(read_json(path), str(path))
    if matrix.shape != (4, 4):
        raise DamagedFrameError(f"{path} must be a 4 x 4 matrix, got {matrix.shape}")
    require_rotation(matrix[:3, :3], f"the rotation of {path}")
    if not np.abs(matrix[:3, 3]).max() <= 100:
        raise DamagedFrameError(f"{path} moves by {np.abs(matrix[:3, 3]).max():.0f} m: lengths must be metres")
    return matrix


DATA_SET = Prox()
