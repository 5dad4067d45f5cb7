"""MoGe 1: colours, cameras, shifts, and the whole kit with a perfect network."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from physic_core.types import Hints
from physic_human.moge import Moge1, Moge1Options
from physic_testing.conformance import parametrize_with_checks
from physic_testing.worlds import world_of

from .seen import OnWorlds, network_of

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
"""


@pytest.fixture
def moge(stub: Callable[..., Path], tmp_path: Path) -> Moge1:
    checkout = stub("moge", {"moge/__init__.py": "", "moge/model/v1.py": MOGE})
    torch.save({"model_config": {}, "model": {}}, tmp_path / "model.pt")
    backend = Moge1(Moge1Options(checkout=str(checkout), weights=str(tmp_path / "model.pt")))
    backend.load()
    return backend


def test_moge_gets_rgb_from_0_to_1(moge: Moge1) -> None:
    image = np.full((60, 80, 3), [255, 51, 0], np.uint8)
    moge.infer(image, Hints())
    np.testing.assert_allclose(network_of(moge).seen[0, :, 30, 40], [1.0, 0.2, 0.0], atol=1e-6)
    assert network_of(moge).tokens == 2500


def test_moges_shift_and_focal_length_are_found(moge: Moge1) -> None:
    found = moge.infer(np.zeros((60, 80, 3), np.uint8), Hints())
    assert found.unknown == "scale"
    assert found.intrinsics is not None
    np.testing.assert_allclose(found.intrinsics.fx, 300, rtol=0.01)
    v, u = np.mgrid[:60, :80]
    truth = 2.0 + 0.01 * u + 0.02 * v
    np.testing.assert_allclose(found.points[..., 2][found.valid], truth[found.valid], rtol=0.01)
    np.testing.assert_array_equal(found.valid, u > 4)


class PerfectMoge:
    """Points of the world in the picture, in units of 2.2 m, moved by 0.7 units along z."""

    num_tokens_range = (1200, 2500)
    mask_threshold = 0.5

    def forward(self, pixels: torch.Tensor, tokens: int) -> dict[str, torch.Tensor]:
        image = np.round(255 * pixels[0].numpy().transpose(1, 2, 0)).astype(np.uint8)
        height, width = image.shape[:2]
        world = world_of(image)
        if world is None:
            v, u = np.mgrid[:height, :width]
            z = 3.0 + 1.5 * v / height + 0.5 * u / width
            points = (
                np.stack([z * (u - (width - 1) / 2), z * (v - (height - 1) / 2), 1.2 * width * z], -1) / 1.2 / width
            )
        else:
            apart = [np.abs(image.astype(int) - other).sum() for other in (world.image, world.empty_image)]
            points = world.points(people=bool(apart[0] < apart[1])).astype(float)
        seen = np.isfinite(points).all(axis=-1)
        points = np.where(seen[..., None], points, 1.0) / 2.2 - [0, 0, 0.7]
        return {"points": torch.from_numpy(points)[None], "mask": torch.from_numpy(np.where(seen, 0.95, 0.02))[None]}


class MogeOnWorlds(OnWorlds, Moge1):
    perfect_network = PerfectMoge


@parametrize_with_checks("relative_pointmap", MogeOnWorlds, capabilities={"exact"})
def test_moge_conforms(check: Callable[[], None]) -> None:
    check()
