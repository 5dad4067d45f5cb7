"""Depth Anything V2 small: its own file, and what is done with its disparity."""

from __future__ import annotations

import math
import shutil
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from physic_core import read_photo
from physic_core.errors import BackendError
from physic_core.types import Hints
from physic_embedded.networks.depth_anything import predict_disparity
from physic_networks.onnx_sessions import open_session
from physic_networks.pictures import resize_map
from physic_onnx.depth_anything import DepthAnything

FILES = ("depth_anything_v2_vits.onnx", "depth_anything_v2_vits.weights")


def test_its_file_answers_as_in_the_embedded_backend(tmp_path, monkeypatch):
    own = Path(str(resources.files("physic_embedded"))) / "weights"
    folder = tmp_path / "depth-anything-v2-small"
    folder.mkdir()
    for name in FILES:
        shutil.copy(own / name, folder / name)
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path))
    photo = read_photo(Path(__file__).parents[3] / "examples" / "basketball.png").image
    # A square photo has whole patches: the embedded backend pads others, and this one stretches
    # them.
    photo = photo[:, 80:560]
    backend = DepthAnything()
    assert backend.missing() == ()
    backend.load()
    answer = backend.infer(photo, Hints())
    session = open_session(own / FILES[0], threads=0, device="cpu", broken="")
    wanted = resize_map(predict_disparity(session, photo, short_side=518), *photo.shape[:2])
    here = 1 / answer.points[..., 2]
    here *= np.median(wanted[answer.valid]) / np.median(here[answer.valid])
    spread = np.percentile(wanted, 99) - np.percentile(wanted, 1)
    off = np.abs(here - wanted)[answer.valid] / spread
    assert answer.valid.mean() > 0.9
    assert answer.unknown == "inverse_scale_shift"
    assert np.median(off) < 0.01
    assert np.percentile(off, 95) < 0.05
    backend.close()
    (folder / FILES[0]).write_bytes((own / FILES[0]).read_bytes()[:-1] + b"x")
    with pytest.raises(BackendError, match="is not the published file"):
        DepthAnything().load()


@pytest.fixture
def answering(bound, stand_in_network):
    """The backend with a network that answers a map (h, w)."""

    def make(values):
        inputs = {"image": (1, 3, "H", "W")}
        return bound(DepthAnything, stand_in_network(inputs, {"depth": values[None]}))

    return make


def test_points_lie_on_the_rays_of_a_default_camera_and_sky_has_none(answering):
    rows = np.linspace(1, 3, 518)[:, None] * np.ones((1, 518))
    rows[:100] = 0
    answer = answering(rows).infer(np.zeros((259, 518, 3), np.uint8), Hints())
    assert not answer.valid[:48].any()
    assert answer.valid[52:].all()
    camera, z = answer.intrinsics, answer.points[..., 2]
    assert camera.fx == pytest.approx(259 / math.tan(math.radians(55.5 / 2)))
    assert camera.guessed
    x, y = (np.arange(518) - camera.cx) / camera.fx, (np.arange(259) - camera.cy) / camera.fy
    np.testing.assert_allclose(answer.points[..., 0], z * x, atol=1e-6)
    np.testing.assert_allclose(answer.points[..., 1], z * y[:, None], atol=1e-6)
    disparity = 1 / z[52:, 0]
    np.testing.assert_allclose(disparity / disparity[-1], rows[104::2, 0] / 3, rtol=0.01)
