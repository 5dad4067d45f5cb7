"""Depth Anything V2 small: its own file, and what is done with its disparity."""

from __future__ import annotations

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
    weights = Path(str(resources.files("physic_embedded"))) / "weights"
    folder = tmp_path / "depth-anything-v2-small"
    folder.mkdir()
    for name in FILES:
        shutil.copy(weights / name, folder / name)
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path))
    photo = read_photo(Path(__file__).parents[3] / "examples" / "basketball.png").image
    # A square photo has whole patches: the embedded backend pads others, and this one stretches
    # them.
    photo = photo[:, 80:560]
    backend = DepthAnything()
    assert backend.missing() == ()
    backend.load()
    answer = backend.infer(photo, Hints())
    session = open_session(weights / FILES[0], threads=0, device="cpu", broken="")
    wanted = resize_map(predict_disparity(session, photo, short_side=518), *photo.shape[:2])
    here = 1 / answer.points[..., 2]
    here *= np.median(wanted[answer.valid]) / np.median(here[answer.valid])
    spread = np.percentile(wanted, 99) - np.percentile(wanted, 1)
    off = np.abs(here - wanted)[answer.valid] / spread
    assert answer.valid.mean() > 0.9
    assert answer.unknown == "inverse_scale_shift"
    rays = answer.points[..., :2] / answer.points[..., 2:] * answer.intrinsics.fx
    places = np.stack(np.meshgrid(np.arange(480), np.arange(480)), -1) - 239.5
    np.testing.assert_allclose(rays[answer.valid], places[answer.valid], atol=1e-2)
    assert np.median(off) < 0.01
    assert np.percentile(off, 95) < 0.05
    backend.close()
    (folder / FILES[0]).write_bytes((weights / FILES[0]).read_bytes()[:-1] + b"x")
    with pytest.raises(BackendError, match="is not the published file"):
        DepthAnything().load()
