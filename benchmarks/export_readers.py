"""Readers of the exported files, and what each has of a result: people, the largest difference, and
what else.

Every reader is the library that a user of the format has. Where it only gives what the file says,
the rules of the format are applied here: skinning of glTF, unprojection of depth.
"""

from __future__ import annotations

import contextlib
import csv
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from physic_core import Person, Reconstruction
from physic_core.body.joints import JOINT_NAMES
from physic_core.geometry.upright import transform_points
from physic_core.types import skeleton_named

Array = NDArray[Any]

_FARTHEST_M = 65.535
"""Largest depth that 16 bits hold in millimetres."""

_CONTACT_SHARE = 0.02
"""Vertices on seams count more than once in some formats."""

_BODY_JOINTS = JOINT_NAMES[:22]
_ANGLES = {
    f"{name}_{side[0]}": f"{side}_{angle}"
    for name, angle in (("hip_flexion", "hip_flexion"), ("knee_angle", "knee_flexion"))
    for side in ("left", "right")
}
"""Coordinate of OpenSim's model -> angle of ``Person.joint_angles``."""

_GLTF_TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_GLTF_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


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

    def box(self, person: Person) -> Array:
        """Return the least and the largest corner (2, 3) of a person."""
        return _box(self.vertices(person))

    def known(self, farthest: float = np.inf) -> Array:
        """Return which pixels (H, W) of the scene have a depth up to a limit."""
        scene = self.result.scene
        return scene.valid & (scene.points[..., 2] <= farthest)


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


def _compare_named(
    files: Files,
    meshes: Mapping[str, Any],
    box_of: Callable[[Any], Any],
    more_of: Callable[[Any, Person], str],
) -> Opened:
    """Compare the corners of the meshes that are named after people; what else is of the first."""
    present = [
        (meshes[name], person) for i, person in files.bodies if (name := f"person_{i}") in meshes
    ]
    more = more_of(*present[0]) if present else ""
    return _compare(files, (box_of(mesh) for mesh, _ in present), files.box, more)


def _compare_objects(files: Files, places: Array, objects: Array, more: str = "") -> Opened:
    """Compare the vertices of people, who are objects 0 and more of a point cloud."""
    present = [n for n in np.unique(objects) if n >= 0]
    return _compare(files, (places[objects == n] for n in present), files.vertices, more)


def _compare_cloud(files: Files, places: Array, more: str) -> Opened:
    """Compare the vertices of people with the nearest points of a cloud (n, 3)."""
    cloud = cKDTree(places)
    away = [cloud.query(files.vertices(person))[0].max() for _, person in files.bodies]
    return Opened(None, float(max(away, default=0.0)), more)


def _box(points: Any) -> Array:
    return np.stack([np.min(points, 0), np.max(points, 0)])


def _contact(values: Any, person: Person) -> str:
    """Say whether the share of vertices in contact is that of a person."""
    share = float((np.ravel(values) > 0.5).mean())
    return "contact" if abs(share - person.contact.mean()) < _CONTACT_SHARE else "other contact"


def read_amass(files: Files) -> Opened:
    found = []
    for path in files.ending(".npz"):
        with np.load(path) as arrays:
            found.append([arrays["pelvis"] + arrays["trans"][0]])
    return _compare(files, found, lambda person: files.joints(person)[:1])


def read_bodies(files: Files) -> Opened:
    with np.load(files.ending(".npz")[0]) as arrays:
        found = list(arrays["transl"][:, None].astype(np.float64))
    return _compare(files, found, lambda person: files.points(person.parameters.transl))


def read_bvh(files: Files) -> Opened:
    import bvhio

    from physic_export.skeleton import bone_names

    found = []
    for path in files.ending(".bvh"):
        root = bvhio.readAsHierarchy(path).loadPose(1)
        places = {one.Name: list(one.PositionWorld) for one, _, _ in root.layout()}
        found.append([places[name] for name in bone_names("mixamo")])
    return _compare(files, found, files.joints)


def read_coco(files: Files) -> Opened:
    from pycocotools.coco import COCO

    with contextlib.redirect_stdout(sys.stderr):
        data = COCO(files.ending(".json")[0])
    worst = 0.0
    for one in data.anns.values():
        person = files.result.people[one["person"]]
        seen = person.keypoint_confidence > 0
        got = np.reshape(one["keypoints"], (-1, 3))
        pixels = files.result.file_pixels(person.keypoints[seen])
        worst = max(worst, apart(got[got[:, 2] > 0, :2], pixels))
        if data.annToMask(one).sum() != one["area"]:
            worst = np.inf
    outside = sum(not person.mask.any() for _, person in files.bodies)
    return Opened(len(data.anns) + outside, worst)


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


def _picture(path: str | Path) -> Array:
    """Return a picture as it is in its file.

    Raises:
        ValueError: OpenCV cannot read it.
    """
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise ValueError(f"OpenCV cannot read {path}")
    return np.asarray(picture)


def _masks(files: Files) -> int:
    """Return how many masks of people are those of the result."""
    masks = [_picture(path) > 0 for path in files.ending(".png")]
    return sum(any(np.array_equal(one, person.mask) for one in masks) for _, person in files.bodies)


def _depth_difference(files: Files, depth: Array, given: Array, farthest: float) -> float:
    """Return the largest difference of a depth (H, W), metres; inf if others are unknown."""
    known = files.known(farthest)
    if not np.array_equal(given, known):
        return np.inf
    return apart(depth[known], files.result.scene.points[known][:, 2])


def read_depth(files: Files) -> Opened:
    depth = _picture(files.ending("depth.png")[0]) / 1000
    return Opened(_masks(files), _depth_difference(files, depth, depth > 0, _FARTHEST_M))


def read_exr(files: Files) -> Opened:
    import OpenEXR

    with OpenEXR.File(files.ending("zdepth.exr")[0]) as file:
        depth = file.channels()["Z"].pixels
    return Opened(_masks(files), _depth_difference(files, depth, depth < 1e9, np.inf))


def read_trimesh(files: Files) -> Opened:
    import trimesh

    def more(mesh: Any, person: Person) -> str:
        return f"{mesh.visual.kind}, {_contact(mesh.vertex_attributes['_CONTACT'], person)}"

    meshes = trimesh.load_scene(files.ending(".glb")[0]).geometry
    return _compare_named(files, meshes, lambda mesh: mesh.bounds, more)


def read_open3d(files: Files) -> Opened:
    import open3d

    model = open3d.io.read_triangle_model(files.ending(".glb")[0])
    return _compare_named(
        files,
        {one.mesh_name: one.mesh for one in model.meshes},
        lambda mesh: [mesh.get_min_bound(), mesh.get_max_bound()],
        lambda mesh, _: "texture" if mesh.has_triangle_uvs() else "",
    )


def read_pymeshlab(files: Files) -> Opened:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(files.ending(".glb")[0])
    named = {one.label(): one for one in meshes}
    return _compare_named(files, named, lambda mesh: _box(mesh.vertex_matrix()), lambda *_: "")


def read_assimp(files: Files) -> Opened:
    import assimp_py

    scene = assimp_py.import_file(files.ending(".glb")[0], assimp_py.Process_Triangulate)
    return _compare_named(
        files,
        {mesh.name: mesh for mesh in scene.meshes},
        lambda mesh: _box(np.reshape(mesh.vertices, (-1, 3))),
        lambda mesh, _: "texture" if mesh.texcoords else "",
    )


def read_blender(files: Files) -> Opened:
    """Read the pose at frame 1."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=files.ending(".glb")[0], disable_bone_shape=True)
    bpy.context.scene.frame_set(1)

    def box(body: Any) -> Array:
        posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
        points = np.array([body.matrix_world @ vertex.co for vertex in posed.vertices])
        return _box(points[:, [0, 2, 1]] * [1, 1, -1])

    def more(body: Any, person: Person) -> str:
        contact = _contact([one.value for one in body.data.attributes["_CONTACT"].data], person)
        texture = "texture, " if body.data.uv_layers else ""
        bones = len(bpy.data.objects[f"{body.name}_skeleton"].data.bones)
        return f"{texture}{contact}, {bones} joints"

    return _compare_named(files, bpy.data.objects, box, more)


def read_glb(files: Files) -> Opened:
    import pygltflib

    tree = pygltflib.GLTF2().load(files.ending(".glb")[0])
    world = _gltf_world(tree)
    found = []
    more = ""
    for index, person in files.bodies:
        (node,) = (one for one in tree.nodes if one.name == f"person_{index}" and one.mesh)
        names = tree.meshes[node.mesh].primitives[0].attributes
        sets = [n for n in (0, 1) if getattr(names, f"JOINTS_{n}", None) is not None]
        skin = tree.skins[node.skin]
        inverse = _gltf_array(tree, skin.inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
        turns = np.stack([world[joint] for joint in skin.joints]) @ inverse
        joints, weights = (
            np.concatenate([_gltf_array(tree, getattr(names, f"{key}_{n}")) for n in sets], 1)
            for key in ("JOINTS", "WEIGHTS")
        )
        count = len(person.vertices)
        place = np.pad(
            _gltf_array(tree, names.POSITION)[:count], ((0, 0), (0, 1)), constant_values=1
        )
        blended = np.einsum("vj,vjab->vab", weights[:count], turns[joints[:count].astype(int)])
        found.append(np.einsum("vab,vb->va", blended, place)[:, :3])
        contact = _contact(_gltf_array(tree, names._CONTACT)[:count], person)
        more = f"{contact}, {len(skin.joints)} joints"
    return _compare(files, found, files.vertices, more)


def _gltf_array(tree: Any, number: int) -> Array:
    one = tree.accessors[number]
    view = tree.bufferViews[one.bufferView]
    kind = np.dtype(_GLTF_TYPES[one.componentType])
    width = _GLTF_WIDTHS[one.type]
    start = (view.byteOffset or 0) + (one.byteOffset or 0)
    steps = (view.byteStride or width * kind.itemsize, kind.itemsize)
    values: Array = np.ndarray((one.count, width), kind, tree.binary_blob(), start, steps)
    return values / np.iinfo(kind).max if one.normalized else values


def _gltf_world(tree: Any) -> dict[int, Array]:
    """Return node -> (4, 4) pose at the end of the first animation."""
    for channel in tree.animations[0].channels if tree.animations else ():
        values = _gltf_array(tree, tree.animations[0].samplers[channel.sampler].output)
        setattr(tree.nodes[channel.target.node], channel.target.path, values[-1].tolist())
    world: dict[int, Array] = {}

    def place(number: int, above: Array) -> None:
        node = tree.nodes[number]
        local = np.eye(4)
        if node.matrix:
            local = np.reshape(node.matrix, (4, 4)).T
        local[:3, :3] = (
            local[:3, :3] @ Rotation.from_quat(node.rotation or (0, 0, 0, 1)).as_matrix()
        )
        local[:3, :3] *= node.scale or (1, 1, 1)
        local[:3, 3] += node.translation or (0, 0, 0)
        world[number] = above @ local
        for child in node.children or ():
            place(child, world[number])

    for root in tree.scenes[tree.scene].nodes:
        place(root, np.eye(4))
    return world


def read_keypoints(files: Files) -> Opened:
    with open(files.ending(".csv")[0], newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = skeleton_named(files.result.skeleton).names
    worst = 0.0
    for index, person in files.bodies:
        own = {row["joint"]: row for row in rows if int(row["person"]) == index}
        seen = [n for n, value in enumerate(person.keypoint_confidence) if value > 0]
        got = [[float(own[names[n]][axis]) for axis in "xy"] for n in seen]
        worst = max(worst, apart(got, files.result.file_pixels(person.keypoints[seen])))
    return Opened(len({row["person"] for row in rows}), worst)


def _shape_of(points: Any) -> Array:
    """Return joints (22, 3) without their common height: people are set down on the floor."""
    made = np.array(points, np.float64)
    made[:, 2] -= made[0, 2]
    return made


def read_mjcf(files: Files) -> Opened:
    import mujoco

    model = mujoco.MjModel.from_xml_path(files.ending(".xml")[0])
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = [model.body(number).name for number in range(model.nbody)]
    found = []
    for index, _ in files.bodies:
        if f"person_{index}" in names:
            own = [f"person_{index}", *(f"person_{index}_{one}" for one in _BODY_JOINTS[1:])]
            found.append(_shape_of([data.body(name).xpos for name in own]))
    heavy = model.body_subtreemass[model.body("person_0").id] if "person_0" in names else 0.0
    more = f"{heavy:.1f} kg" if heavy else ""
    return _compare(files, found, lambda person: _shape_of(files.joints(person)[:22]), more)


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


def read_nerfstudio(files: Files) -> Opened:
    path = Path(files.ending("transforms.json")[0])
    camera = json.loads(path.read_text(encoding="utf-8"))
    frame = camera["frames"][0]
    depth = _picture(path.with_name(frame["depth_file_path"]))
    known = files.known(_FARTHEST_M)
    if not np.array_equal(depth > 0, known):
        return Opened(None, np.inf)
    z = depth[known] * camera["depth_unit_scale_factor"]
    rows, columns = np.nonzero(known)
    x = (columns + 0.5 - camera["cx"]) / camera["fl_x"]
    y = (rows + 0.5 - camera["cy"]) / camera["fl_y"]
    # a camera of OpenGL looks along -z with y up
    points = transform_points(np.array(frame["transform_matrix"]), np.stack([x * z, -y * z, -z], 1))
    return Opened(None, apart(points, files.points(files.result.scene.points[known])))


def read_stl(files: Files) -> Opened:
    import trimesh

    meshes = [trimesh.load_mesh(path) for path in files.ending(".stl")]
    metres = (mesh.bounds / 1000 for mesh in meshes)
    closed = sum(mesh.is_watertight for mesh in meshes)
    return _compare(files, metres, files.box, f"{closed} closed")


def read_obj(files: Files) -> Opened:
    import trimesh

    # trimesh names a mesh after its material
    meshes = trimesh.load_scene(files.ending(".obj")[0]).geometry
    people = 0
    worst = 0.0
    for index, person in files.bodies:
        if mesh := meshes.get(f"person_{index}_photo"):
            people += 1
            # a vertex on a seam is several in the reader
            wanted = files.vertices(person)
            there = cKDTree(mesh.vertices).query(wanted)[0].max()
            back = cKDTree(wanted).query(mesh.vertices)[0].max()
            worst = max(worst, float(there), float(back))
    return Opened(people, worst)


def read_ply(files: Files) -> Opened:
    from plyfile import PlyData

    table = PlyData.read(files.ending(".ply")[0])["vertex"]
    return _compare_objects(files, np.stack([table[axis] for axis in "xyz"], 1), table["object"])


def read_open3d_points(files: Files) -> Opened:
    import open3d

    cloud = open3d.t.io.read_point_cloud(files.ending(".ply")[0]).point
    names = [name for name in ("colors", "contact", "object", "quality") if name in cloud]
    objects = cloud["object"].numpy().ravel()
    return _compare_objects(files, cloud["positions"].numpy(), objects, ", ".join(names))


def read_pymeshlab_points(files: Files) -> Opened:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(files.ending(".ply")[0])
    cloud = meshes.current_mesh()
    more = ["colours"] if cloud.has_vertex_color() else []
    more += ["probability of contact as quality"] if cloud.vertex_scalar_array().any() else []
    return _compare_cloud(files, cloud.vertex_matrix(), ", ".join(more))


def read_vtk(files: Files) -> Opened:
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkPLYReader()
    reader.SetFileName(files.ending(".ply")[0])
    reader.Update()
    cloud = reader.GetOutput()
    more = "colours" if cloud.GetPointData().HasArray("RGB") else ""
    return _compare_cloud(files, vtk_to_numpy(cloud.GetPoints().GetData()), more)


def read_rrd(files: Files) -> Opened:
    from rerun.chunk import RrdReader

    found = {}
    colours: list[Any] = []
    for chunk in RrdReader(files.ending(".rrd")[0]).stream().to_chunks():
        batch = chunk.to_record_batch()
        if "Mesh3D:vertex_positions" in batch.schema.names and "person_" in chunk.entity_path:
            (index,) = [int(chunk.entity_path.rpartition("_")[2])]
            found[index] = batch.column("Mesh3D:vertex_positions").to_pylist()[0]
        if "Mesh3D:vertex_colors" in batch.schema.names and "person_0" in chunk.entity_path:
            colours += batch.column("Mesh3D:vertex_colors").to_pylist()
    more = "contact as colours of the last step" if colours and colours[0] != colours[-1] else ""
    return _compare(files, (found[index] for index in sorted(found)), files.vertices, more)


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


def _compare_robots(files: Files, read: Callable[[str], tuple[Iterable[str], str]]) -> Opened:
    """Compare the names of the joints of each person's URDF with those of its pose."""
    off = 0
    more = ""
    paths = [path for path in files.ending(".urdf") if not path.endswith("_scene.urdf")]
    for path in paths:
        names, more = read(path)
        pose = json.loads(Path(path).with_suffix(".json").read_text(encoding="utf-8"))
        off = max(off, len({*names} ^ {*pose["joints"]}))
    return Opened(len(paths), off, more)


def read_pybullet(files: Files) -> Opened:
    import pybullet

    pybullet.connect(pybullet.DIRECT)

    def read(path: str) -> tuple[list[str], str]:
        body = pybullet.loadURDF(path, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        joints = range(pybullet.getNumJoints(body))
        mass = sum(pybullet.getDynamicsInfo(body, link)[0] for link in (-1, *joints))
        names = [pybullet.getJointInfo(body, joint)[1].decode() for joint in joints]
        return names, f"{len(names)} joints, {mass:.1f} kg with the links between axes"

    return _compare_robots(files, read)


def read_pinocchio(files: Files) -> Opened:
    import pinocchio

    def read(path: str) -> tuple[list[str], str]:
        free = pinocchio.JointModelFreeFlyer()
        folder = str(Path(path).parent)
        model, shapes, _ = pinocchio.buildModelsFromUrdf(path, [folder], free)
        names = list(model.names)[2:]  # without the universe and the free flyer
        mass = pinocchio.computeTotalMass(model)
        return names, f"{len(names)} joints, {mass:.1f} kg, {shapes.ngeoms} shapes"

    return _compare_robots(files, read)


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


def read_usd(files: Files) -> Opened:
    from pxr import Usd, UsdGeom, UsdSkel

    stage = Usd.Stage.Open(files.ending(".usdc")[0])
    UsdSkel.BakeSkinning(stage.Traverse())
    found = []
    more = ""
    for index, person in files.bodies:
        if prim := stage.GetPrimAtPath(f"/physic/person_{index}/mesh"):
            points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(1))
            # rows are vectors in USD
            place = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(1)).T
            found.append(transform_points(place, points.astype(np.float64)))
            values = UsdGeom.PrimvarsAPI(prim).GetPrimvar("contact").Get()
            skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath(f"/physic/person_{index}/skeleton"))
            joints = len(skeleton.GetJointsAttr().Get())
            more = f"{_contact(values, person)}, {joints} joints"
    return _compare(files, found, files.vertices, more)
