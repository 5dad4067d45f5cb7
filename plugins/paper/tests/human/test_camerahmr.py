"""CameraHMR: the camera of its crops, and SMPL bodies in the given camera."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.types import Hints, Intrinsics, Keypoints, People
from physic_human.camerahmr import CameraHmr, CameraHmrOptions
from physic_testing.body_files import smpl_arrays

from .conftest import reading
from .seen import coordinates, normalised_back, place_of

NUM_KEYPOINTS = Keypoints(np.zeros((2, 17, 2)), np.zeros((2, 17)), "coco17")
CAMERA = Intrinsics(500.0, 500.0, 140.0, 105.0, 300, 200)

CHECKOUT = {
    "core/constants.py": "SMPL_MEAN_PARAMS_FILE = "
    "'data/chmr/smpl_mean_params.npz'\nNUM_POSE_PARAMS = 23\n",
    "core/heads/smpl_head_cliff.py": """
import pathlib
from ..constants import SMPL_MEAN_PARAMS_FILE
assert pathlib.Path(SMPL_MEAN_PARAMS_FILE).is_file(), SMPL_MEAN_PARAMS_FILE
""",
    "core/camerahmr_model.py": """
import torch
from .heads import smpl_head_cliff

class CameraHMR(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.zeros(1))
        self.seen = []

    def forward(self, batch):
        self.seen.append({key: value.numpy().copy() for key, value in batch.items()})
        count = len(batch["img"])
        eye = torch.eye(3).expand(count, 24, 3, 3)
        parameters = {"global_orient": eye[:, :1], "body_pose": eye[:, 1:], "betas": self.gain * torch.ones(count, 10)}
        return parameters, torch.tensor([[0.9, 0.05, -0.1]]).expand(count, 3), batch["cam_int"][:, 0, 0]
""",  # noqa: E501
}


def people():
    boxes = np.array([[100.0, 40, 140, 140], [200.0, 60, 260, 100]])
    return People(np.zeros((2, 200, 300), bool), boxes, np.ones(2))


@pytest.fixture
def make_backend(stub, tmp_path, smpl_file):
    checkout = stub("chmr", CHECKOUT)
    files = tmp_path / "files"
    files.mkdir()
    state = {"gain": torch.ones(1), "smpl.faces": torch.zeros(3)}
    torch.save({"state_dict": state}, files / "camerahmr_checkpoint_cleaned.ckpt")
    (files / "smpl_mean_params.npz").write_bytes(b"")

    def make(**options):
        camera = {"state_dict": {"gain": torch.ones(1)}}
        torch.save(camera, files / "cam_model_cleaned.ckpt")
        places = {"checkout": str(checkout), "smpl_file": str(smpl_file)}
        backend = reading(CameraHmr(CameraHmrOptions(**places, **options)), files)
        backend.load()
        return backend

    return make


def run_network(backend, image=coordinates(200, 300)):  # noqa: B008
    return backend.infer(image, people(), CAMERA, NUM_KEYPOINTS, Hints())


def test_the_network_gets_squares_of_the_longer_side_and_the_given_camera(make_backend):
    """Boxes are relative to its principal point; red comes first."""
    backend = make_backend()
    run_network(backend)
    inputs = backend.network[0].seen[0]
    for crop, middle, side in zip(
        inputs["img"], [[119.5, 89.5], [229.5, 79.5]], [100, 60], strict=True
    ):
        place = place_of(normalised_back(crop), 200, 300)
        assert place.step[0] > 0
        np.testing.assert_allclose(place.at(0.5), middle, atol=0.8)
        np.testing.assert_allclose(256 * place.step, side, rtol=0.02)
    np.testing.assert_allclose(inputs["box_size"], [100, 60])
    np.testing.assert_allclose(inputs["cam_int"][:, 0, 0], 500)
    np.testing.assert_allclose(inputs["img_size"], [[200, 300]] * 2)
    # What it computes is box_center - img_size / 2.
    np.testing.assert_allclose(
        inputs["box_center"][0] - [150, 100], [119.5 - 140, 89.5 - 105], atol=1e-4
    )


def test_bodies_are_seen_where_the_crop_has_them(make_backend, smpl_file):
    bodies = run_network(make_backend())
    place = bodies.parameters.transl[0]
    np.testing.assert_allclose(place[2], 2 * 500 / (100 * 0.9), rtol=1e-5)
    pixel = 500 * place[:2] / place[2] + [140, 105]
    np.testing.assert_allclose(pixel, np.add([119.5, 89.5], 45 * np.array([0.05, -0.1])), rtol=1e-5)
    assert bodies.body_model == "smpl"
    arrays = smpl_arrays()
    shaped = arrays["v_template"] + arrays["shapedirs"].sum(axis=2)  # all betas are 1
    np.testing.assert_allclose(
        bodies.joints[0, 0] - place, arrays["J_regressor"][0] @ shaped, atol=1e-5
    )
    assert np.isnan(bodies.joints[:, 22:]).all()
    np.testing.assert_allclose(bodies.mesh.rest, arrays["v_template"], atol=1e-6)
