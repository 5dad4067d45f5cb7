"""Open the exports of a result with other programs, and print a row for each: version, place, and
what else arrives.

    .venv/bin/python tools/open_exports.py RESULT

RESULT is the folder of a result with a floor and a person. The ``physic`` command of ``.venv``
writes the files; the programs are installed in a temporary environment, with the versions below.
``docs/exports.md`` has the rows.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

import numpy as np

from physic_core import Reconstruction
from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import export_frame

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "trimesh": "5.2.0",
    "open3d": "0.20.0",
    "pymeshlab": "2025.7.post1",
    "pygltflib": "1.16.5",
    "usd-core": "26.11",
    "mujoco": "4.0.0",
    "pybullet": "3.2.7",
    "pycocotools": "2.0.11",
    "pycolmap": "4.2.1",
}
FORMATS = ("glb", "ply", "usd", "mjcf", "urdf", "coco", "colmap")

READERS = {
    "trimesh": """
import trimesh
mesh = trimesh.load_scene("combined.glb").geometry["person_0"]
say("combined.glb", mesh.bounds, "colours: " + type(mesh.visual).__name__)
""",
    "open3d": """
import open3d
model = open3d.io.read_triangle_model("combined.glb")
(mesh,) = (one.mesh for one in model.meshes if one.mesh_name == "person_0")
cloud = open3d.t.io.read_point_cloud("points.ply")
kept = sorted(name for name in ("contact", "quality", "object", "colors") if name in cloud.point)
say("combined.glb, points.ply", [mesh.get_min_bound(), mesh.get_max_bound()], "attributes: " + ", ".join(kept))
""",  # noqa: E501
    "pymeshlab": """
import pymeshlab
meshes = pymeshlab.MeshSet()
meshes.load_new_mesh("points.ply")
quality = meshes.current_mesh().vertex_scalar_array()
meshes.load_new_mesh("combined.glb")
(mesh,) = (one for one in meshes if one.label() == "person_0")
box = mesh.bounding_box()
say("combined.glb, points.ply", [box.min(), box.max()], f"quality up to {quality.max():.2f}")
""",
    "pygltflib": """
import pygltflib
tree = pygltflib.GLTF2().load("combined.glb")
(mesh,) = (one for one in tree.meshes if one.name == "person_0")
place = tree.accessors[mesh.primitives[0].attributes.POSITION]
contact = mesh.primitives[0].attributes._CONTACT is not None
say("combined.glb", [place.min, place.max], f"contact: {contact}, joints: {len(tree.skins[0].joints)}")
""",  # noqa: E501
    "usd-core": """
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open("stage.usdc")
cache = UsdGeom.BBoxCache(1, ["default"])
box = cache.ComputeWorldBound(stage.GetPrimAtPath("/physic/person_0")).ComputeAlignedRange()
low, high = box.GetMin(), box.GetMax()
say("stage.usdc", [[low[0], low[2], -high[1]], [high[0], high[2], -low[1]]], "bounds of the SkelRoot")
""",  # noqa: E501
    "mujoco": """
import mujoco
model = mujoco.MjModel.from_xml_path("mujoco.xml")
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, model.key("photo").id)
mujoco.mj_forward(model, data)
head = data.body("person_0_head").xpos.copy()
while data.time < 1.5:
    mujoco.mj_step(model, data)
fall = head[2] - data.body("person_0_head").xpos[2]
mass = model.body_subtreemass[model.body("person_0").id]
say("mujoco.xml", None, f"{mass:.1f} kg, head sinks by {100 * fall:.0f} cm in 1.5 s")
""",
    "pybullet": """
import glob, pybullet
pybullet.connect(pybullet.DIRECT)
body = pybullet.loadURDF(sorted(glob.glob("robot*[!e].urdf"))[0], flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
mass = sum(pybullet.getDynamicsInfo(body, link)[0] for link in range(-1, pybullet.getNumJoints(body)))
say("robot_0.urdf", None, f"{mass:.1f} kg, {pybullet.getNumJoints(body)} joints")
""",  # noqa: E501
    "pycocotools": """
from pycocotools.coco import COCO
data = COCO("coco.json")
shares = [data.annToMask(one).sum() / one["area"] for one in data.anns.values()]
say("coco.json", None, f"{len(shares)} people, masks of {min(shares):.3f} to {max(shares):.3f} of their areas")
""",  # noqa: E501
    "pycolmap": """
import pycolmap
model = pycolmap.Reconstruction("sparse/0")
image = model.images[1]
apart = max(abs(image.project_point(model.points3D[p.point3D_id].xyz) - p.xy).max() for p in list(image.points2D)[::99])
say("sparse/0", None, f"{len(model.points3D)} points, {apart:.4f} px off")
""",  # noqa: E501
}
"""Code of each program, run in the folder of the files; ``say`` gets a file, bounds (y up) or None,
and a remark.
"""

SAY = """
import json, sys
def say(file, bounds, remark):
    made = None if bounds is None else [[float(value) for value in row] for row in bounds]
    print("ROW " + json.dumps([file, made, remark]))
"""


def main(folder: Path) -> int:
    """Print the table; return 1 if a program cannot read its file."""
    result = Reconstruction.load(str(folder))
    matrix = export_frame(result.scene.floor, "y").from_camera
    vertices = transform_points(matrix, result.people[0].vertices)
    wanted = np.stack([vertices.min(0), vertices.max(0)])
    failed = 0
    with tempfile.TemporaryDirectory() as made:
        files = Path(made, "files")
        files.mkdir()
        result.save(str(files))
        for form in FORMATS:
            result.export(str(files), form)
        venv.create(Path(made, "venv"), with_pip=True)
        python = str(Path(made, "venv", "bin", "python"))
        pins = [f"{name}=={version}" for name, version in PACKAGES.items()]
        subprocess.run([python, "-m", "pip", "install", "--quiet", *pins], check=True)
        print("| program | file | person's bounds off by | what else |\n|---|---|---|---|")
        for name, code in READERS.items():
            done = subprocess.run(
                [python, "-c", SAY + code], cwd=files, capture_output=True, text=True
            )
            row = next((line for line in done.stdout.splitlines() if line.startswith("ROW ")), None)
            if row is None:
                failed = 1
                print(
                    f"| {name} {PACKAGES[name]} | failed: {done.stderr.strip().splitlines()[-1]} "
                    f"| | |"
                )
                continue
            file, bounds, remark = json.loads(row.removeprefix("ROW "))
            off = (
                "-"
                if bounds is None
                else f"{1000 * np.abs(np.array(bounds) - wanted).max():.1f} mm"
            )
            print(f"| {name} {PACKAGES[name]} | {file} | {off} | {remark} |")
    return failed


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
