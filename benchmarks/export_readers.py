"""Programs that open exported files, and what each has of a result: people, the largest difference,
and what else.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physic_core import Person, Reconstruction
from physic_core.body.joints import JOINT_NAMES
from physic_core.geometry.upright import transform_points

Array = NDArray[Any]

_CONTACT_SHARE = 0.02
"""Vertices on seams count more than once in some formats."""

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

    def vertices(self, person: Person) -> Array:
        return self.points(person.vertices)

    def joints(self, person: Person) -> Array:
        return self.points(person.joints)


@dataclass(frozen=True)
class Opened:
    """What became of a result in a reader.

    Attributes:
        people: whom it has; None in a format without people.
        difference: the largest.
        more: what else arrives, in words.
        refused: why the format refuses the result; "" if it was exported.
        fault: why the reader does not have it; "" if it does.
    """

    people: int | None = None
    difference: float = 0.0
    more: str = ""
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


def _compare(
    files: Files, found: Iterable[Any], wanted: Callable[[Person], Array], more: str = ""
) -> Opened:
    """Return how what a reader has of each person differs from what the result has."""
    got = list(found)
    pairs = zip(got, files.bodies, strict=False)
    worst = max((apart(one, wanted(person)) for one, (_, person) in pairs), default=0.0)
    return Opened(len(got), worst, more)


def read_bvh(files: Files) -> Opened:
    import bvhio

    from physic_export.skeleton import bone_names

    found = []
    for path in files.ending(".bvh"):
        root = bvhio.readAsHierarchy(path).loadPose(1)
        places = {one.Name: list(one.PositionWorld) for one, _, _ in root.layout()}
        found.append([places[name] for name in bone_names("mixamo")])
    return _compare(files, found, files.joints)


def read_colmap(files: Files) -> Opened:
    import pycolmap

    model = pycolmap.Reconstruction(str(Path(files.ending("cameras.bin")[0]).parent))
    image = model.images[1]
    pixels = np.array([one.xy for one in image.points2D])
    columns, rows = (pixels - 0.5).round().astype(int).T
    places = [model.points3D[one.point3D_id].xyz for one in image.points2D]
    off = apart([image.project_point(place) for place in places], pixels)
    more = f"projected within {max(off, 1e-3):.3f} px"
    wanted = files.points(files.result.scene.points[rows, columns])
    return Opened(None, apart(places, wanted), more)


def read_blender(files: Files) -> Opened:
    """Read the corners of people in the pose at frame 1."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=files.ending(".glb")[0], disable_bone_shape=True)
    bpy.context.scene.frame_set(1)
    found = []
    more = ""
    for index, person in files.bodies:
        if body := bpy.data.objects.get(f"person_{index}"):
            posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
            points = np.array([body.matrix_world @ vertex.co for vertex in posed.vertices])
            found.append(corners(points[:, [0, 2, 1]] * [1, 1, -1]))
            values = np.array([one.value for one in body.data.attributes["_CONTACT"].data])
            touching = abs((values > 0.5).mean() - person.contact.mean()) < _CONTACT_SHARE
            bones = len(bpy.data.objects[f"{body.name}_skeleton"].data.bones)
            texture = "texture, " if body.data.uv_layers else ""
            more = f"{texture}{'contact' if touching else 'other contact'}, {bones} joints"
    return _compare(files, found, lambda person: corners(files.vertices(person)), more)


def corners(points: Array) -> Array:
    """Return the least and the largest corner (2, 3) of points (n, 3)."""
    return np.stack([points.min(0), points.max(0)])


def _shape_of(points: Any) -> Array:
    """Return joints (22, 3) without their common height: people are set down on the floor."""
    made = np.array(points, np.float64)
    made[:, 2] -= made[0, 2]
    return made


def read_mot(files: Files) -> Opened:
    import opensim

    opensim.Logger.setLevelString("error")
    found = []
    more = ""
    for path in files.ending(".mot"):
        motion = opensim.Storage(path)
        labels = motion.getColumnLabels()
        values = motion.getStateVector(0).getData()
        unit = 1.0 if motion.isInDegrees() else np.degrees(1.0)
        # the first label is the time, which is no value
        row = {labels.get(n): unit * values.get(n - 1) for n in range(1, labels.getSize())}
        found.append([row[name] for name in _ANGLES])
        more = f"{len(row)} coordinates in {'degrees' if motion.isInDegrees() else 'radians'}"
    return _compare(
        files, found, lambda one: np.array([one.joint_angles[n] for n in _ANGLES.values()]), more
    )


def read_open3d_points(files: Files) -> Opened:
    import open3d

    cloud = open3d.t.io.read_point_cloud(files.ending(".ply")[0]).point
    names = [name for name in ("colors", "contact", "object", "quality") if name in cloud]
    objects, places = cloud["object"].numpy().ravel(), cloud["positions"].numpy()
    people = (places[objects == n] for n in np.unique(objects) if n >= 0)
    return _compare(files, people, files.vertices, ", ".join(names))


def read_trc(files: Files) -> Opened:
    import opensim

    opensim.Logger.setLevelString("error")
    found = []
    for path in files.ending(".trc"):
        data = opensim.MarkerData(path)
        data.convertToUnits(opensim.Units("m"))
        frame = data.getFrame(0)
        markers = [frame.getMarker(n) for n in range(data.getNumMarkers())]
        found.append([[one.get(axis) for axis in range(3)] for one in markers])
    return _compare(files, found, lambda person: files.joints(person)[:22])


def read_urdf(files: Files) -> Opened:
    import yourdfpy

    found = []
    for path in files.ending(".urdf"):
        if path.endswith("_scene.urdf"):
            continue
        robot = yourdfpy.URDF.load(path)
        pose = json.loads(Path(path).with_suffix(".json").read_text(encoding="utf-8"))
        robot.update_cfg(pose["joints"])
        links = np.array([robot.get_transform(one, "pelvis")[:3, 3] for one in _BODY_JOINTS])
        base = Rotation.from_quat(np.roll(pose["base"]["quaternion_wxyz"], -1))
        found.append(_shape_of(base.apply(links) + pose["base"]["position_m"]))
    return _compare(files, found, lambda person: _shape_of(files.joints(person)[:22]))


def read_asset_validator(files: Files) -> Opened:
    """Count failures. Those of extents stand apart: the validator asks for the bounds that OpenUSD
    computes of a skeleton's joints, and the file states those of the skin.
    """
    from omni.asset_validator import IssueSeverity, ValidationEngine

    issues = ValidationEngine().validate(files.ending(".usdc")[0]).issues()
    bad = (IssueSeverity.ERROR, IssueSeverity.FAILURE)
    rules = [one.rule.__name__ if one.rule else "" for one in issues if one.severity in bad]
    extents = rules.count("ExtentsChecker")
    return Opened(None, len(rules) - extents, f"{extents} extents of skeletons")
