"""MoGe 1 and MoGe-3: colours, cameras and shifts."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.errors import PhysicError
from physic_core.types import CameraTrust, Hints, Intrinsics
from physic_human.moge import Moge1, Moge1Options, Moge3Depth, Moge3Options

from .conftest import reading

MOGE = """
import torch

class MoGeModel(torch.nn.Module):
    num_tokens_range = [1200, 2500]
    mask_threshold = 0.5

    @classmethod
    def from_pretrained(cls, place):
        assert torch.load(place)["model_config"] == {}
        return cls()

    def forward(self, image, num_tokens):
        self.seen, self.tokens = image.numpy().copy(), num_tokens
        height, width = image.shape[-2:]
        v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        z = 2.0 + 0.01 * u + 0.02 * v
        points = torch.stack([z * (u - (width - 1) / 2) / 300, z * (v - (height - 1) / 2) / 300, z - 1.5], -1)
        mask = torch.where(u > 4, 0.9, 0.1)
        return {"points": points[None], "mask": mask[None]}
"""  # noqa: E501


@pytest.fixture
def moge(stub, tmp_path):
    checkout = stub("moge", {"moge/__init__.py": "", "moge/model/v1.py": MOGE})
    torch.save({"model_config": {}, "model": {}}, tmp_path / "model.pt")
    backend = reading(Moge1(Moge1Options(checkout=str(checkout))), tmp_path / "model.pt")
    backend.load()
    return backend


def test_moges_shift_and_focal_length_are_found(moge):
    pointmap = moge.infer(np.full((60, 80, 3), [255, 51, 0], np.uint8), Hints())
    np.testing.assert_allclose(moge.network.seen[0, :, 30, 40], [1.0, 0.2, 0.0], atol=1e-6)
    assert moge.network.tokens == 2500
    assert pointmap.unknown == "scale"
    np.testing.assert_allclose(pointmap.intrinsics.fx, 300, rtol=0.01)
    v, u = np.mgrid[:60, :80]
    truth = 2.0 + 0.01 * u + 0.02 * v
    np.testing.assert_allclose(
        pointmap.points[..., 2][pointmap.valid], truth[pointmap.valid], rtol=0.01
    )
    np.testing.assert_array_equal(pointmap.valid, u > 4)


# A checkout that imports GPU kernels at the top, as the published one does.
MOGE_3 = """
import torch
import utils3d
from flex_gemm.nn import SubmanifoldConv3d
from flex_gemm.ops import NeighborCache

class MoGeModel(torch.nn.Module):
    num_tokens_range = [1200, 3600]

    def __init__(self, refiner=None, scale_head=True):
        super().__init__()
        self.runs = 0
        self.shift, self.scale_head = torch.nn.Parameter(torch.zeros(1)), scale_head
        if refiner is not None:
            self.refiner = SubmanifoldConv3d(3, 1)

    def forward(self, image, num_tokens, refine_steps=3):
        assert refine_steps == 0 and num_tokens == 3600
        self.runs += 1
        height, width = image.shape[-2:]
        v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        z = 2.0 + 0.01 * u + 0.02 * v
        points = torch.stack([z * (u - (width - 1) / 2) / 300, z * (v - (height - 1) / 2) / 300, z - self.shift], -1)
        scale = {"metric_scale": torch.full((1,), 1.5)} if self.scale_head else {}
        return {"points": points[None], "mask": torch.where(u > 4, 0.9, 0.1)[None]} | scale
"""  # noqa: E501


@pytest.fixture
def moge_3(stub, tmp_path):
    def make(state=None, **config):
        checkout = stub("moge3", {"moge/__init__.py": "", "moge/model/v3.py": MOGE_3})
        tensors = {
            name: torch.full((1,), value) for name, value in (state or {"shift": 1.5}).items()
        }
        torch.save(
            {"model_config": {"refiner": {}, **config}, "model": tensors}, tmp_path / "model.pt"
        )
        options = Moge3Options(checkout=str(checkout))
        return reading(Moge3Depth(options), tmp_path / "model.pt")

    return make


def test_moge_3_runs_on_a_cpu_without_the_kernels_of_its_refiner(moge_3):
    backend = moge_3({"shift": 1.5, "refiner.weight": 0.0})
    backend.load()
    assert not {"flex_gemm", "flex_gemm.nn", "flex_gemm.ops", "utils3d_moge"} & sys.modules.keys()
    depth_map = backend.infer(np.zeros((60, 80, 3), np.uint8), Hints())
    v, u = np.mgrid[:60, :80]
    np.testing.assert_allclose(
        depth_map.depth[u > 4], 1.5 * (2.0 + 0.01 * u + 0.02 * v)[u > 4], rtol=0.01
    )
    assert np.isnan(depth_map.depth[u <= 4]).all()
    np.testing.assert_allclose(depth_map.intrinsics.fx, 300, rtol=0.01)


def test_a_known_camera_is_followed_by_moge_3_and_a_guessed_one_is_not(moge_3):
    backend = moge_3()
    backend.load()
    image = np.zeros((60, 80, 3), np.uint8)
    for trust, fx in ((CameraTrust.KNOWN, 200.0), (CameraTrust.GUESSED, 300.0)):
        camera = replace(Intrinsics.from_focal(200.0, 80, 60), trust=trust)
        intrinsics = backend.infer(image, Hints(intrinsics=camera)).intrinsics
        np.testing.assert_allclose(intrinsics.fx, fx, rtol=0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"state": {"other": 1.0}}, "is missing 1 of 1 parameters"),
        ({"scale_head": False}, "expected points, mask, metric_scale"),
    ],
)
def test_what_moge_3_cannot_do_is_refused(moge_3, options, words):
    def use(backend):
        backend.load()
        backend.infer(np.zeros((60, 80, 3), np.uint8), Hints())

    with pytest.raises(PhysicError, match=words):
        use(moge_3(**options))
