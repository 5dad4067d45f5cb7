"""Write cameras by the tools themselves: plugins/scene/tests/rigs, all but easymocap.

    .venv/bin/python tools/real_files/cameras.py

It needs a network: the packages below go to a temporary folder. The tools are installed without
what they require, as their requirements contradict each other; NumPy, OpenCV, SciPy and torch are
those of this environment. ``points.json`` has for each file and camera rows of a point of the world
and of its pixel, by the tool's own camera, in the tool's own convention of pixels.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np

TOOLS = "pose2sim==0.10.49 aniposelib==0.8.0 caliscope==0.11.8 pycolmap==4.2.1 nerfstudio==1.1.5"
LIBRARIES = """numba==0.68.1 pandas==3.1.1 matplotlib==3.11.2 rtoml==0.14.0 toml==0.10.2 c3d==0.6.0 anytree==2.13.0
    lxml==6.1.3 tqdm==4.70.1 platformdirs==4.14.8 appdirs==1.4.4 jaxtyping==0.3.11 tyro==1.0.17 viser==1.1.1
    imageio==2.38.1 mediapy==1.2.7"""  # noqa: E501
RIGS = Path(__file__).resolve().parents[2] / "plugins" / "scene" / "tests" / "rigs"
NAMES = ("left", "middle", "right")
SIZES = ((1920, 1080), (1280, 720), (1280, 720))
FOCAL = ((1400.0, 1410.0), (950.0, 950.0), (930.0, 925.0))
CENTRES = ((967.25, 533.5), (640.5, 352.0), (633.0, 361.75))
DISTORTION = (
    (-0.11, 0.02, 0.0012, -0.0021),
    (-0.2, 0.05, 0.0, 0.0),
    (0.04, -0.01, -0.0007, 0.0005),
)
PLACES = np.array([(-2.0, -3.0, 1.5), (0.0, -3.5, 1.2), (2.0, -3.0, 1.5)])  # metres, z up
POINTS = np.array([(0.0, 0.0, 1.0), (0.3, -0.2, 1.6), (-0.4, 0.3, 0.1)])


def rotation(place: np.ndarray) -> np.ndarray:
    """Return the rotation from the world to a camera that looks at the first point."""
    forward = (POINTS[0] - place) / np.linalg.norm(POINTS[0] - place)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(forward, right), forward))


def matrix(i: int) -> np.ndarray:
    return np.array([[FOCAL[i][0], 0, CENTRES[i][0]], [0, FOCAL[i][1], CENTRES[i][1]], [0, 0, 1]])


R = [rotation(place) for place in PLACES]
T = [-R[i] @ PLACES[i] for i in range(3)]
RODRIGUES = [cv2.Rodrigues(one)[0].ravel() for one in R]


def rows(pixels: Any, points: np.ndarray = POINTS) -> list[list[float]]:
    return np.concatenate((points, np.reshape(pixels, (-1, 2))), 1).tolist()


def pose2sim(folder: Path) -> dict[str, Any]:
    from Pose2Sim.calibration import toml_write
    from Pose2Sim.common import retrieve_calib_params

    K = [matrix(i) for i in range(3)]
    toml_write(folder / "pose2sim.toml", NAMES, SIZES, DISTORTION, K, RODRIGUES, T)
    own = retrieve_calib_params(folder / "pose2sim.toml")
    # As its triangulation reprojects.
    pixels = [
        cv2.projectPoints(POINTS, own["R"][i], own["T"][i], own["K"][i], own["dist"][i])[0]
        for i in range(3)
    ]
    return dict(zip(NAMES, map(rows, pixels), strict=True))


def anipose(folder: Path) -> dict[str, Any]:
    """In mm, as its boards are measured."""
    from aniposelib.cameras import Camera, CameraGroup, FisheyeCamera

    def group(kind: type, count: int) -> Any:
        return CameraGroup(
            [
                kind(
                    matrix(i),
                    np.array((*DISTORTION[i], 0.0))[:count],
                    SIZES[i],
                    RODRIGUES[i],
                    1000 * T[i],
                    NAMES[i],
                )
                for i in range(3)
            ]
        )

    group(FisheyeCamera, 4).dump(folder / "anipose_fisheye.toml")
    group(Camera, 5).dump(folder / "anipose.toml")
    pixels = CameraGroup.load(folder / "anipose.toml").project(1000 * POINTS)
    return {name: rows(own, 1000 * POINTS) for name, own in zip(NAMES, pixels, strict=True)}


def caliscope(folder: Path) -> dict[str, Any]:
    """The second camera lies on its side: its pictures are upright after three quarter turns."""
    from caliscope.cameras.camera_array import CameraArray, CameraData

    cameras = {
        i: CameraData(
            i,
            SIZES[i],
            (0, 3, 0)[i],
            0.3,
            matrix(i),
            np.array((*DISTORTION[i], 0.0)),
            translation=T[i],
            rotation=R[i],
        )
        for i in range(3)
    }
    CameraArray(cameras).to_toml(folder / "caliscope.toml")
    CameraArray(cameras).to_aniposelib_toml(folder / "caliscope_aniposelib.toml")
    found = {}
    for i, one in CameraArray.from_toml(folder / "caliscope.toml").cameras.items():
        vector = one.extrinsics_to_vector()
        pixels = cv2.projectPoints(POINTS, vector[:3], vector[3:], one.matrix, one.distortions)[0]
        found[f"cam_{i}"] = rows(pixels)
    return found


def colmap(folder: Path) -> dict[str, Any]:
    """With the binary model that nerfstudio reads."""
    import pycolmap

    model = pycolmap.Reconstruction()
    kinds = ("OPENCV", "SIMPLE_RADIAL", "FULL_OPENCV")
    for i, kind in enumerate(kinds):
        fx, fy = FOCAL[i]
        cx, cy = np.array(CENTRES[i]) + 0.5
        params = {
            "OPENCV": (fx, fy, cx, cy, *DISTORTION[i]),
            "SIMPLE_RADIAL": (fx, cx, cy, DISTORTION[i][0]),
            "FULL_OPENCV": (fx, fy, cx, cy, *DISTORTION[i], 0.003, 0, 0, 0),
        }[kind]
        width, height = SIZES[i]
        camera = pycolmap.Camera(
            model=kind, width=width, height=height, params=params, camera_id=i + 1
        )
        model.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(name=f"{NAMES[i]}/0001.jpg", camera_id=i + 1, image_id=i + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(R[i]), T[i])
        model.add_image_with_trivial_frame(image, pose)
    for point in POINTS:  # nerfstudio wants some
        model.add_point3D(point, pycolmap.Track(), np.zeros(3, np.uint8))
    model.write_text(folder / "colmap")
    model.write_binary(folder / "binary")
    again = pycolmap.Reconstruction(folder / "colmap")
    found = {}
    for _, one in sorted(again.images.items()):
        pixels = [
            again.cameras[one.camera_id].img_from_cam(one.cam_from_world() * point)
            for point in POINTS
        ]
        found[one.name] = rows(pixels)
    return found


def nerfstudio(folder: Path) -> dict[str, Any]:
    """From COLMAP's binary model of the first two cameras; the third has a lens that nerfstudio
    refuses.
    """
    import pycolmap
    import torch

    sys.modules["rawpy"] = ModuleType("rawpy")  # reads raw photos, of which there are none
    from nerfstudio.cameras.cameras import Cameras
    from nerfstudio.process_data.colmap_utils import colmap_to_json

    binary = folder / "binary"
    model = pycolmap.Reconstruction(binary)
    model.deregister_frame(3)
    model.write_binary(binary)
    colmap_to_json(binary, folder / "nerfstudio")
    found = {}
    for frame in json.loads((folder / "nerfstudio" / "transforms.json").read_text())["frames"]:
        distortion = torch.tensor(
            [frame[key] for key in ("k1", "k2")] + [0, 0] + [frame[key] for key in ("p1", "p2")]
        )
        own = Cameras(
            torch.tensor(frame["transform_matrix"])[None, :3],
            *(float(frame[key]) for key in ("fl_x", "fl_y", "cx", "cy")),
            frame["w"],
            frame["h"],
            distortion,
        )
        pixels = torch.tensor([[600.0, 200.0], [900.0, 500.0], [640.5, 360.5]])
        rays = own.generate_rays(0, pixels.flip(-1))
        found[frame["file_path"]] = rows(pixels, (rays.origins + 3 * rays.directions).numpy())
    return found


def main() -> None:
    with tempfile.TemporaryDirectory() as packages, tempfile.TemporaryDirectory() as made:
        install = (sys.executable, "-m", "pip", "install", "--quiet", "--target", packages)
        subprocess.run((*install, *LIBRARIES.split()), check=True)
        subprocess.run((*install, "--no-deps", *TOOLS.split()), check=True)
        sys.path.append(packages)
        os.environ["MPLBACKEND"] = "agg"
        folder = Path(made)
        for name in ("colmap", "binary", "nerfstudio"):
            (folder / name).mkdir()
        points = {
            "pose2sim.toml": pose2sim(folder),
            "anipose.toml": anipose(folder),
            "caliscope.toml": caliscope(folder),
            "colmap": colmap(folder),
            "nerfstudio": nerfstudio(folder),
        }
        shutil.rmtree(folder / "binary")
        for rest in (*folder.glob("colmap/[!ci]*"), *folder.glob("nerfstudio/*.ply")):
            rest.unlink()
        (folder / "points.json").write_text(json.dumps(points) + "\n")
        shutil.copytree(folder, RIGS, dirs_exist_ok=True)


if __name__ == "__main__":
    main()
