"""Export results, and open the files with programs of users that no test has.

    python -m benchmarks exports_opened RESULT ...

A row of the table is a format and a program: how many of the exported results it opened with all
people, and the largest difference between what it reads and what the result has, of all people, in
the frame and unit of the file. A result that a format refuses counts apart, with our reason below
the table. Returns 1 if a program is not installed or fails, a person is missing, or a difference
exceeds the limit of its row.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physic_core import InputError, Person, Reconstruction, find_exporter
from physic_core.body.joints import JOINT_NAMES
from physic_core.export import export_frame
from physic_core.geometry.world_frame import transform_points
from physic_testing.metrics import markdown_table

from .fits import parser_of

Array = NDArray[Any]

_BODY_JOINTS = JOINT_NAMES[:22]
_ANGLES = {
    f"{name}_{side[0]}": f"{side}_{angle}"
    for name, angle in (("hip_flexion", "hip_flexion"), ("knee_angle", "knee_flexion"))
    for side in ("left", "right")
}
"""Coordinate of OpenSim's model -> angle of ``Person.joint_angles``."""


@dataclass(frozen=True)
class Files:
    """What a format wrote of a result.

    Attributes:
        result: the result.
        paths: all files.
        matrix: (4, 4), from the camera frame to that of the files, metres.
    """

    result: Reconstruction
    paths: Sequence[Path]
    matrix: Array

    @property
    def bodies(self) -> list[tuple[int, Person]]:
        """Index and person of all who have a body."""
        people = enumerate(self.result.people)
        return [(i, one) for i, one in people if np.isfinite(one.vertices).all()]

    def ending(self, end: str) -> list[str]:
        """Return the paths that end so; files of one person each are in the order of people."""
        return [str(path) for path in self.paths if path.as_posix().endswith(end)]

    def points(self, points: Array) -> Array:
        """Return points (..., 3) of the camera frame in the frame of the files."""
        return transform_points(self.matrix, points.astype(np.float64))


def read_bvh(files: Files) -> list[Any]:
    import bvhio

    from physic_export.skeleton import bone_names

    people = []
    for path in files.ending(".bvh"):
        root = bvhio.readAsHierarchy(path).loadPose(1)
        places = {one.Name: list(one.PositionWorld) for one, _, _ in root.layout()}
        people.append([places[name] for name in bone_names("mixamo")])
    return people


def read_colmap(files: Files) -> float:
    import pycolmap

    model = pycolmap.Reconstruction(str(Path(files.ending("cameras.bin")[0]).parent))
    image = model.images[1]
    pixels = np.array([one.xy for one in image.points2D])
    columns, rows = (pixels - 0.5).round().astype(int).T
    places = [model.points3D[one.point3D_id].xyz for one in image.points2D]
    if apart([image.project_point(place) for place in places], pixels) > 0.01:
        raise ValueError("points do not project onto their pixels")
    return apart(places, files.points(files.result.scene.points[rows, columns]))


def read_blender(files: Files) -> list[Any]:
    """Read the corners of people in the pose at frame 1."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=files.ending(".glb")[0], disable_bone_shape=True)
    bpy.context.scene.frame_set(1)
    people = []
    for index, _ in files.bodies:
        if body := bpy.data.objects.get(f"person_{index}"):
            posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
            points = np.array([body.matrix_world @ vertex.co for vertex in posed.vertices])
            people.append(corners(points[:, [0, 2, 1]] * [1, 1, -1]))
    return people


def corners(points: Array) -> Array:
    """Return the least and the largest corner (2, 3) of points (n, 3)."""
    return np.stack([points.min(0), points.max(0)])


def read_mot(files: Files) -> list[Any]:
    import opensim

    opensim.Logger.setLevelString("error")
    people = []
    for path in files.ending(".mot"):
        motion = opensim.Storage(path)
        labels = motion.getColumnLabels()
        values = motion.getStateVector(0).getData()
        unit = 1.0 if motion.isInDegrees() else np.degrees(1.0)
        # the first label is the time, which is no value
        row = {labels.get(n): unit * values.get(n - 1) for n in range(1, labels.getSize())}
        people.append([row[name] for name in _ANGLES])
    return people


def read_ply(files: Files) -> list[Any]:
    import open3d

    cloud = open3d.t.io.read_point_cloud(files.ending(".ply")[0]).point
    objects, places = cloud["object"].numpy().ravel(), cloud["positions"].numpy()
    return [places[objects == n] for n in np.unique(objects) if n >= 0]


def read_trc(files: Files) -> list[Any]:
    import opensim

    opensim.Logger.setLevelString("error")
    people = []
    for path in files.ending(".trc"):
        data = opensim.MarkerData(path)
        data.convertToUnits(opensim.Units("m"))
        frame = data.getFrame(0)
        markers = [frame.getMarker(n) for n in range(data.getNumMarkers())]
        people.append([[one.get(axis) for axis in range(3)] for one in markers])
    return people


def read_urdf(files: Files) -> list[Any]:
    import yourdfpy

    people = []
    for path in files.ending(".urdf"):
        if path.endswith("_scene.urdf"):
            continue
        robot = yourdfpy.URDF.load(path)
        pose = json.loads(Path(path).with_suffix(".json").read_text(encoding="utf-8"))
        robot.update_cfg(pose["joints"])
        links = np.array([robot.get_transform(one, "pelvis")[:3, 3] for one in _BODY_JOINTS])
        base = Rotation.from_quat(np.roll(pose["base"]["quaternion_wxyz"], -1))
        people.append(_shape_of(base.apply(links) + pose["base"]["position_m"]))
    return people


def _shape_of(points: Any) -> Array:
    """Return joints (22, 3) without their common height: people are set down on the floor."""
    shape = np.array(points, np.float64)
    shape[:, 2] -= shape[0, 2]
    return shape


def read_usd(files: Files) -> float:
    """Count errors and failures of NVIDIA's validator."""
    from omni.asset_validator import IssueSeverity, ValidationEngine

    issues = ValidationEngine().validate(files.ending(".usdc")[0]).issues()
    bad = (IssueSeverity.ERROR, IssueSeverity.FAILURE)
    return float(sum(one.severity in bad for one in issues))


@dataclass(frozen=True)
class Reader:
    """Program that opens a format.

    Attributes:
        form: format.
        distribution: that a user installs.
        module: that it is imported as.
        read: what the program has of each person, or a difference from the result.
        wanted: the same of a person of the result; None of a difference.
        compares: what of a result, with its unit.
        limit: largest difference, in this unit.
    """

    form: str
    distribution: str
    module: str
    read: Callable[[Files], Any]
    wanted: Callable[[Files, Person], Any] | None
    compares: str
    limit: float


_OPENSIM = "opensim", "opensim"
_VALIDATOR = "omniverse-asset-validator", "omni"


def _joints(files: Files, person: Person) -> Array:
    return files.points(person.joints)


def _vertices(files: Files, person: Person) -> Array:
    return files.points(person.vertices)


def _angles(files: Files, person: Person) -> list[float]:
    return [person.joint_angles[name] for name in _ANGLES.values()]


READERS = (
    Reader("bvh", "bvhio", "bvhio", read_bvh, _joints, "55 joints, m", 1e-4),
    Reader("colmap", "pycolmap", "pycolmap", read_colmap, None, "scene, m", 1e-4),
    Reader(
        "glb", "bpy", "bpy", read_blender, lambda *of: corners(_vertices(*of)), "bounds, m", 1e-3
    ),
    Reader("mot", *_OPENSIM, read_mot, _angles, "hips and knees, degrees", 1e-3),
    Reader("ply", "open3d", "open3d", read_ply, _vertices, "vertices, m", 1e-4),
    Reader("trc", *_OPENSIM, read_trc, lambda *of: _joints(*of)[:22], "22 joints, m", 1e-4),
    Reader(
        *("urdf", "yourdfpy", "yourdfpy", read_urdf),
        lambda *of: _shape_of(_joints(*of)[:22]),
        *("22 joints, m", 1e-3),
    ),
    Reader("usd", *_VALIDATOR, read_usd, None, "failures", 0.5),
)


@dataclass(frozen=True)
class Opened:
    """What became of a result in a reader.

    Attributes:
        difference: the largest.
        refused: why the format refuses the result; "" if it was exported.
        fault: why the reader does not have it; "" if it does.
    """

    difference: float = 0.0
    refused: str = ""
    fault: str = ""


def apart(got: Any, wanted: Any) -> float:
    """Return the largest distance of points (n, D), or difference of numbers (n,); inf if there are
    not as many.
    """
    got, wanted = np.asarray(got, np.float64), np.asarray(wanted, np.float64)
    if got.shape != wanted.shape:
        return np.inf
    away = np.abs(got - wanted) if got.ndim == 1 else np.linalg.norm(got - wanted, axis=-1)
    return float(away.max(initial=0.0))


def outcome_of(reader: Reader, folder: str) -> Opened:
    """Export the result of a folder to the format of a reader, open the files, and compare."""
    result = Reconstruction.load(folder)
    with tempfile.TemporaryDirectory() as folder_of_export:
        up = find_exporter(reader.form).record.ups[0]
        # people are not turned until they balance
        options = {"keep_lean": True} if reader.form == "urdf" else {}
        try:
            paths = result.export(folder_of_export, reader.form, **options).files
        except InputError as error:
            return Opened(refused=str(error))
        files = Files(result, paths, export_frame(result.scene.level, up).from_camera)
        try:
            people = reader.read(files)
        except Exception as error:  # whatever a reader raises is what its user sees
            return Opened(fault=f"{type(error).__name__}: {error}")
    if reader.wanted is None:
        return _judged(reader, people)
    if len(people) != len(files.bodies):
        return Opened(fault=f"{len(people)} of {len(files.bodies)} people")
    pairs = zip(people, files.bodies, strict=True)
    off = (apart(one, reader.wanted(files, person)) for one, (_, person) in pairs)
    return _judged(reader, max(off, default=0.0))


def _judged(reader: Reader, difference: float) -> Opened:
    is_wrong = difference > reader.limit
    return Opened(difference, fault=f"differs by {difference:.3g}" if is_wrong else "")


def outcomes_of(reader: Reader, folders: Sequence[str]) -> list[Opened]:
    """Return the outcome of each folder.

    Each reader has a process of its own: the libraries exclude one another, and some end the
    process on a file that they do not like.
    """
    outcomes = []
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for folder in folders:
            try:
                outcomes.append(pool.submit(outcome_of, reader, folder).result())
            except BrokenProcessPool:
                outcomes.append(Opened(fault="the reader ended the process"))
                break
    return outcomes + [Opened(fault="not tried")] * (len(folders) - len(outcomes))


def row_of(reader: Reader, outcomes: Sequence[Opened]) -> list[str]:
    """Return the row of a reader."""
    written = [one for one in outcomes if not one.refused]
    opened = [one for one in written if not one.fault]
    return [
        reader.form,
        reader.distribution,
        f"{len(opened)} of {len(written)}",
        str(len(outcomes) - len(written) or ""),
        reader.compares,
        f"{max(one.difference for one in opened):.2g}" if opened else "",
    ]


def main() -> int:
    """Print the table, reasons and faults."""
    parser = parser_of("exports_opened", __doc__, fits=False)
    parser.add_argument("results", nargs="+", help="folders of results")
    results = parser.parse_args().results
    rows = [["format", "reader", "opened", "refused", "compared, unit", "largest difference"]]
    refused: list[str] = []
    faults: list[str] = []
    for reader in READERS:
        outcomes = outcomes_of(reader, results)
        rows.append(row_of(reader, outcomes))
        for folder, one in zip(results, outcomes, strict=True):
            if one.fault:
                faults.append(f"{reader.form}, {reader.distribution}, {folder}: {one.fault}")
            if one.refused:
                refused.append(f"{reader.form} refuses: {one.refused}")
    print(markdown_table(rows), *dict.fromkeys([*faults, *refused]), sep="\n")
    return int(bool(faults))
