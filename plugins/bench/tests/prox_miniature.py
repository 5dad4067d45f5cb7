"""PROX quantitative in small: four frames of a standing person, in the tree and formats of the
set.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from .miniatures import STANDING, moved_by, moved_parameters, python2_pickle, rigid, rotation

SIZE = (480, 270)
K = np.array([[265.0, 0, 240.2], [0, 265.1, 134.2], [0, 0, 1]])
TO_SCENE = rigid(rotation("x", -100) @ rotation("z", 3), [0.4, -1.2, 1.6])
"""From the camera, which looks ahead and down, to the scene, where z is up."""

TO_SCENE_FROM_VICON = rigid(rotation("z", 70), [2.0, 0.5, 0.03])
POSES = {
    f"s001_frame_{i:05d}__00.00.0{i}.023": {
        "body_pose": np.eye(1, 63, 3 * 16 + 2)[0] * 0.3 * i,
        "transl": [0.2 * i, 0, 3.4],
    }
    for i in range(4)
}


@dataclass(frozen=True)
class Miniature:
    """The folder, and what is true of each frame.

    Attributes:
        root: of the set.
        vertices: id -> (10475, 3) m, camera frame.
        joints: id -> (55, 3) m, camera frame.
        height: id -> (10475,) m over the floor of the scan.
        faces: (F, 3).
        mesh_frame: frame of reference of the meshes.
    """

    root: Path
    vertices: dict[str, np.ndarray]
    joints: dict[str, np.ndarray]
    height: dict[str, np.ndarray]
    faces: np.ndarray
    mesh_frame: str = "vicon"


def floor_of(side_m=12.0):
    """A square floor at z = 0, z up."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side_m / 2
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def write_prox(root, files, mesh_frame="vicon"):
    """Write the set; the person's lowest vertex is 1 cm over the floor."""
    miniature = Miniature(root, {}, {}, {}, files.faces, mesh_frame)
    for part in ("calibration", "cam2world", "scenes"):
        (root / part).mkdir(parents=True, exist_ok=True)
    calibration = {
        "camera_mtx": K.tolist(),
        "k": [[0.02, -0.03, 0.001, 0.0005, 0.01]],
        "f": [1, 1],
        "c": [1, 1],
    }
    (root / "calibration" / "Color.json").write_text(json.dumps(calibration))
    (root / "cam2world" / "vicon.json").write_text(json.dumps(TO_SCENE.tolist()))
    (root / "vicon2scene.json").write_text(json.dumps(TO_SCENE_FROM_VICON.tolist()))
    floor_of().export(root / "scenes" / "vicon.ply")
    recording = "vicon_03301_01"
    for name, pose in POSES.items():
        betas = np.array([0.5, -0.3, *[0.0] * 8])
        parameters = _on_floor(files, {**STANDING, **pose, "betas": betas})
        vertices, joints = files.bodies.pose_smplx(parameters, "male")
        key = f"{recording}/{name}"
        miniature.vertices[key] = vertices
        miniature.joints[key] = joints
        miniature.height[key] = moved_by(TO_SCENE, vertices)[:, 2]
        to_file = {
            "camera": np.eye(4),
            "scene": TO_SCENE,
            "vicon": np.linalg.inv(TO_SCENE_FROM_VICON) @ TO_SCENE,
        }[mesh_frame]
        folder = root / "fittings" / "mosh" / recording
        mesh = folder / "meshes" / name / "000.ply"
        mesh.parent.mkdir(parents=True)
        trimesh.Trimesh(moved_by(to_file, vertices), miniature.faces, process=False).export(mesh)
        moved = moved_parameters(files, to_file, parameters, "male")
        python2_pickle(
            folder / "results" / name / "000.pkl",
            {k: np.array(v, np.float32)[None] for k, v in moved.items()},
        )
        _write_picture(root / "recordings" / recording / "Color" / f"{name}.jpg")
    return miniature


def _on_floor(files, parameters):
    down = TO_SCENE[2, :3]  # up of the scene, in the camera frame
    lowest = moved_by(TO_SCENE, files.bodies.pose_smplx(parameters, "male")[0])[:, 2].min()
    return parameters | {"transl": np.array(parameters["transl"]) + down * (0.01 - lowest)}


def _write_picture(path):
    """What the camera saw is red on its left; the file is mirrored."""
    pixels = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    pixels[:, SIZE[0] // 2 :] = 255, 0, 0
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, quality=95)
