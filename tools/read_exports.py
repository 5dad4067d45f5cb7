"""Open the exported files of a result with one program, and print what arrives as JSON.

    python tools/read_exports.py PROGRAM FOLDER

``PROGRAM`` is a name of ``PROGRAMS``, and must be installed for this Python, which needs nothing
else. ``tools/open_exports.py`` writes the folder.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Arrived:
    """What a program has of the files.

    Attributes:
        files: their names.
        bounds: least and largest x, y, z of person 0 in metres, y up; None if the program gives
            none.
        contact: share of the vertices of person 0, or of all people, that are in contact; None if
            it does not arrive.
        colours: what the colours are; "" if they do not arrive.
        joints: number of joints of person 0; None if they do not arrive.
        more: what else, in words.
    """

    files: str
    bounds: Any = None
    contact: float | None = None
    colours: str = ""
    joints: int | None = None
    more: str = ""


def read_trimesh() -> Arrived:
    import trimesh

    mesh = trimesh.load_scene("combined.glb").geometry["person_0"]
    contact = mesh.vertex_attributes["_CONTACT"]
    return Arrived("combined.glb", mesh.bounds, (contact > 0.5).mean(), mesh.visual.kind)


def read_open3d() -> Arrived:
    import open3d

    model = open3d.io.read_triangle_model("combined.glb")
    (mesh,) = (one.mesh for one in model.meshes if one.mesh_name == "person_0")
    cloud = open3d.t.io.read_point_cloud("points.ply").point
    contact = cloud["contact"].numpy()[cloud["object"].numpy() == 0]
    bounds = [mesh.get_min_bound(), mesh.get_max_bound()]
    colours = "texture, `colors` of points" if "colors" in cloud else ""
    return Arrived(
        "combined.glb, points.ply",
        bounds,
        contact.mean(),
        colours,
        more="`o3d.t.io.read_point_cloud` has `contact`, `object`, `quality`",
    )


def read_pymeshlab() -> Arrived:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh("points.ply")
    quality = meshes.current_mesh().vertex_scalar_array()
    people = int((quality > 0).sum())
    colours = "of vertices" if meshes.current_mesh().has_vertex_color() else ""
    meshes.load_new_mesh("combined.glb")
    (mesh,) = (one for one in meshes if one.label() == "person_0")
    box = mesh.bounding_box()
    return Arrived(
        "combined.glb, points.ply",
        [box.min(), box.max()],
        None,
        colours,
        more="probability of contact as `quality`" if people else "",
    )


def read_pygltflib() -> Arrived:
    import numpy as np
    import pygltflib

    tree = pygltflib.GLTF2().load("combined.glb")
    (mesh,) = (one for one in tree.meshes if one.name == "person_0")
    names = mesh.primitives[0].attributes
    place = tree.accessors[names.POSITION]
    contact = tree.accessors[names._CONTACT]
    start = tree.bufferViews[contact.bufferView].byteOffset
    kind = {5121: np.uint8, 5126: np.float32}[contact.componentType]
    values = np.frombuffer(tree.binary_blob(), kind, contact.count, start)
    joints = len(tree.skins[0].joints)
    bounds = [place.min, place.max]
    return Arrived("combined.glb", bounds, (values > 0.5).mean(), "texture", joints)


def read_assimp() -> Arrived:
    import assimp_py
    import numpy as np

    scene = assimp_py.import_file("combined.glb", assimp_py.Process_Triangulate)
    (mesh,) = (one for one in scene.meshes if one.name == "person_0")
    vertices = np.array(mesh.vertices).reshape(-1, 3)
    colours = "texture" if mesh.texcoords else ""
    return Arrived("combined.glb", [vertices.min(0), vertices.max(0)], None, colours)


def read_vtk() -> Arrived:
    import vtk

    reader = vtk.vtkPLYReader()
    reader.SetFileName("points.ply")
    reader.Update()
    arrays = reader.GetOutput().GetPointData()
    names = [arrays.GetArrayName(number) for number in range(arrays.GetNumberOfArrays())]
    return Arrived("points.ply", colours="of vertices" if "RGB" in names else "")


def read_usd() -> Arrived:
    import numpy as np
    from pxr import Usd, UsdGeom, UsdSkel

    stage = Usd.Stage.Open("stage.usdc")
    cache = UsdGeom.BBoxCache(1, ["default"])
    person = stage.GetPrimAtPath("/physic/person_0")
    box = cache.ComputeWorldBound(person).ComputeAlignedRange()
    low = box.GetMin()
    high = box.GetMax()
    mesh = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/physic/person_0/mesh"))
    contact = np.array(mesh.GetPrimvar("contact").Get())
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/physic/person_0/skeleton"))
    return Arrived(
        "stage.usdc",
        [[low[0], low[2], -high[1]], [high[0], high[2], -low[1]]],
        (contact > 0.5).mean(),
        "texture",
        len(skeleton.GetJointsAttr().Get()),
        more="bounds of the SkelRoot",
    )


def read_mujoco() -> Arrived:
    import mujoco

    model = mujoco.MjModel.from_xml_path("mujoco.xml")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hinges = sum(model.joint(i).name.startswith("person_0_") for i in range(model.njnt)) - 1
    mass = model.body_subtreemass[model.body("person_0").id]
    head = float(data.body("person_0_head").xpos[2])
    while data.time < 1.5:
        mujoco.mj_step(model, data)
    moved = abs(float(data.body("person_0_head").xpos[2]) - head)
    kept = "keeps its height" if moved < 0.02 else f"moves by {100 * moved:.0f} cm"
    return Arrived("mujoco.xml", joints=hinges, more=f"{mass:.1f} kg; the head {kept} for 1.5 s")


def read_pybullet() -> Arrived:
    import pybullet

    pybullet.connect(pybullet.DIRECT)
    inertia = pybullet.URDF_USE_INERTIA_FROM_FILE
    body = pybullet.loadURDF("robot_0.urdf", flags=inertia)
    links = range(-1, pybullet.getNumJoints(body))
    mass = sum(pybullet.getDynamicsInfo(body, link)[0] for link in links)
    joints = pybullet.getNumJoints(body)
    return Arrived("robot_0.urdf", joints=joints, more=f"{mass:.1f} kg with the links between axes")


def read_pinocchio() -> Arrived:
    import pinocchio

    root = pinocchio.JointModelFreeFlyer()
    model, shapes, _ = pinocchio.buildModelsFromUrdf("robot_0.urdf", ["."], root)
    mass = pinocchio.computeTotalMass(model)
    return Arrived(
        "robot_0.urdf",
        joints=model.njoints - 2,  # without the universe and the free flyer
        more=f"{mass:.1f} kg with a free-flyer root, {shapes.ngeoms} shapes",
    )


def read_pycocotools() -> Arrived:
    from pycocotools.coco import COCO

    with contextlib.redirect_stdout(sys.stderr):
        data = COCO("coco.json")
    areas = [data.annToMask(one).sum() == one["area"] for one in data.anns.values()]
    same = "their stated areas" if all(areas) else "other areas"
    return Arrived("coco.json", more=f"{len(areas)} people, masks of {same}")


def read_opensim() -> Arrived:
    import opensim

    markers = opensim.MarkerData("markers_0.trc")
    motion = opensim.Storage("motion_0.mot")
    unit = "degrees" if motion.isInDegrees() else "radians"
    count = motion.getColumnLabels().getSize() - 1  # without the time
    return Arrived(
        "markers_0.trc, motion_0.mot",
        joints=markers.getNumMarkers(),
        more=f"{markers.getUnits().getLabel()}; {count} coordinates in {unit}",
    )


def read_pycolmap() -> Arrived:
    import pycolmap

    model = pycolmap.Reconstruction("sparse/0")
    image = model.images[1]
    apart = max(
        abs(image.project_point(model.points3D[pixel.point3D_id].xyz) - pixel.xy).max()
        for pixel in list(image.points2D)[::99]
    )
    near = "within 0.001 px of" if apart < 1e-3 else f"{apart:.3f} px off"
    return Arrived("sparse/0", more=f"{len(model.points3D):,} points, {near} their pixels")


def read_rerun() -> Arrived:
    import numpy as np
    from rerun.chunk import RrdReader

    columns: dict[str, list[Any]] = {}
    for chunk in RrdReader("recording.rrd").stream().to_chunks():
        if chunk.entity_path == "/world/person_0":
            batch = chunk.to_record_batch()
            for name in (one for one in batch.schema.names if one.startswith("Mesh3D:")):
                columns.setdefault(name, []).extend(batch.column(name).to_pylist())
    vertices = np.array(columns["Mesh3D:vertex_positions"][0])
    colours = [np.array(row) for row in columns["Mesh3D:vertex_colors"]]
    touching = (colours[0] != colours[-1]).any()
    return Arrived(
        "recording.rrd",
        [vertices.min(0), vertices.max(0)],
        None,
        "of vertices",
        more="contact as colours of the last step" if touching else "",
    )


def read_blender() -> Arrived:
    import bpy
    import numpy as np

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath="skinned.glb", disable_bone_shape=True)
    bpy.context.scene.frame_set(1)
    body = bpy.data.objects["person_0"]
    posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = np.array([body.matrix_world @ vertex.co for vertex in posed.vertices])
    points = points[:, [0, 2, 1]] * [1, 1, -1]
    contact = np.array([one.value for one in body.data.attributes["_CONTACT"].data])
    return Arrived(
        "skinned.glb",
        [points.min(0), points.max(0)],
        (contact > 0.5).mean(),
        "texture" if body.data.uv_layers else "",
        len(bpy.data.objects["person_0_skeleton"].data.bones),
        more="the pose at frame 1",
    )


def read_bvhio() -> Arrived:
    import bvhio

    root = bvhio.readAsHierarchy("skeleton_0.bvh")
    return Arrived("skeleton_0.bvh", joints=len(root.layout()))


def read_yourdfpy() -> Arrived:
    import yourdfpy

    robot = yourdfpy.URDF.load("robot_0.urdf")
    return Arrived("robot_0.urdf", joints=len(robot.actuated_joint_names))


PROGRAMS: dict[str, tuple[str, str, Callable[[], Arrived]]] = {
    "trimesh": ("trimesh", "trimesh", read_trimesh),
    "Open3D": ("open3d", "open3d", read_open3d),
    "pymeshlab": ("pymeshlab", "pymeshlab", read_pymeshlab),
    "pygltflib": ("pygltflib", "pygltflib", read_pygltflib),
    "assimp-py": ("assimp-py", "assimp_py", read_assimp),
    "VTK": ("vtk", "vtk", read_vtk),
    "Blender": ("bpy", "bpy", read_blender),
    "usd-core": ("usd-core", "pxr", read_usd),
    "rerun-sdk": ("rerun-sdk", "rerun", read_rerun),
    "MuJoCo": ("mujoco", "mujoco", read_mujoco),
    "PyBullet": ("pybullet", "pybullet", read_pybullet),
    "Pinocchio": ("pin", "pinocchio", read_pinocchio),
    "yourdfpy": ("yourdfpy", "yourdfpy", read_yourdfpy),
    "bvhio": ("bvhio", "bvhio", read_bvhio),
    "pycocotools": ("pycocotools", "pycocotools", read_pycocotools),
    "OpenSim": ("opensim", "opensim", read_opensim),
    "pycolmap": ("pycolmap", "pycolmap", read_pycolmap),
}
"""Program -> its distribution, its module, its reader, which runs in the folder of the files."""


def main(program: str, folder: str) -> None:
    """Print ``Arrived`` and the version as the last line."""
    distribution, _, reader = PROGRAMS[program]
    os.chdir(folder)
    row = asdict(reader())
    if row["bounds"] is not None:
        row["bounds"] = [[float(value) for value in corner] for corner in row["bounds"]]
    if row["contact"] is not None:
        row["contact"] = float(row["contact"])
    print("\n" + json.dumps(row | {"version": importlib.metadata.version(distribution)}))


if __name__ == "__main__":
    main(*sys.argv[1:])
