"""The saved result that is exported, and a made-up SMPL-X body."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from physic_core import Reconstruction, export_reconstruction
from physic_core.body import load_body
from physic_core.export import export_frame
from physic_core.geometry.world_frame import transform_points

sys.path.append(str(Path(__file__).parents[4] / "tests" / "body"))  # other_body.py

from other_body import make, smplx_file_arrays


@pytest.fixture(scope="session")
def other():
    """The embedded body in a mesh with the number of vertices of SMPL-X, its joints elsewhere."""
    return make(load_body("embedded"), 10475)


@pytest.fixture(scope="session")
def file(other, tmp_path_factory):
    """An SMPL-X file of that body."""
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_FEMALE.npz"
    np.savez(path, **smplx_file_arrays(other))
    yield path
    path.unlink()  # pytest keeps folders of old runs


@pytest.fixture(scope="session")
def result(saved_pair):
    return Reconstruction.load(str(saved_pair))


@pytest.fixture(scope="session")
def rays(result):
    """(H, W, 3) the point of each pixel at a depth of 1."""
    camera = result.intrinsics
    rows, columns = np.indices(result.scene.valid.shape)
    return np.stack(
        [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], -1
    )


@pytest.fixture(scope="session")
def in_frame(result):
    """A function that gives points of the camera's frame in that of an export."""

    def transform(points, up="z"):
        return transform_points(export_frame(result.scene.floor, up).from_camera, points)

    return transform


@pytest.fixture(scope="session")
def simulated():
    """A function that gives MuJoCo's model and data of a file, some seconds after the photo."""
    mujoco = pytest.importorskip("mujoco")

    def run(file, seconds=0.0):
        model = mujoco.MjModel.from_xml_path(str(file))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        while data.time < seconds:
            mujoco.mj_step(model, data)
        return model, data

    return run


@pytest.fixture
def export(result, tmp_path):
    """Export the result, or another one, to a file name in a new folder."""

    def write(name, format=None, *, of=result, **options):
        return export_reconstruction(of, tmp_path / name, format, **options)

    return write
