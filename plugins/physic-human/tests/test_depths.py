"""UniDepth V2 and MoGe 1: pixels' edges and centres, cameras, shifts, and the whole kit with perfect networks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from physic_core.types import CameraTrust, DepthMap, Hints, Intrinsics, Pointmap
from physic_human.moge import Moge1, Moge1Options
from physic_human.unidepth import UniDepth, UniDepthOptions
from physic_testing.conformance import parametrize_with_checks
from physic_testing.worlds import build_world, world_of

from .seen import OnWorlds, network_of

UNIDEPTH = """
import pathlib
import torch

class UniDepthV2(torch.nn.Module):
    @classmethod
    def from_pretrained(cls, place):
        assert pathlib.Path(place, "config.json").read_text() == "{}"
        return cls()

    # As in its own code, but for the kind of device: there is "cuda", and float16.
    @torch.no_grad()
    @torch.autocast("cpu", dtype=torch.bfloat16)
    def infer(self, rgb, camera=None, normalize=True):
        assert not torch.is_autocast_enabled("cpu") and not torch.is_grad_enabled()
        assert rgb.dtype == torch.uint8 and rgb.ndim == 3 and rgb.shape[0] == 3
        self.seen = (rgb.numpy().copy(), None if camera is None else camera.numpy().copy())
        if camera is not None:
            camera[..., 0, 2] -= 100  # as its own code does when it pads
        print("inferring")
        _, height, width = rgb.shape
        depth = torch.full((1, 1, height, width), 3.0)
        depth[..., 0, 0] = float("inf")
        k = torch.tensor([[[400.0, 0, width / 2], [0, 400.0, height / 2], [0, 0, 1]]])
        return {"depth": depth, "intrinsics": k, "points": depth.expand(1, 3, height, width), "confidence": depth}
"""

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
def unidepth(stub: Callable[..., Path], tmp_path: Path) -> UniDepth:
    checkout = stub("unidepth", {"unidepth/__init__.py": "", "unidepth/models/__init__.py": UNIDEPTH})
    files = tmp_path / "files"
    files.mkdir()
    (files / "config.json").write_text("{}")
    backend = UniDepth(UniDepthOptions(checkout=str(checkout), weights=str(files)))
    backend.load()
    return backend


def test_unidepth_gets_the_camera_by_the_edges_of_pixels(unidepth: UniDepth) -> None:
    camera = Intrinsics(500.0, 510.0, 30.0, 20.0, 64, 48)
    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    found = unidepth.infer(image, Hints(intrinsics=camera))
    rgb, matrix = network_of(unidepth).seen
    np.testing.assert_array_equal(rgb, image.transpose(2, 0, 1))
    np.testing.assert_allclose(matrix[0], [[500, 0, 30.5], [0, 510, 20.5], [0, 0, 1]])
    assert found.intrinsics == camera


def test_unidepths_own_camera_comes_back_in_the_centres_of_pixels(unidepth: UniDepth) -> None:
    found = unidepth.infer(np.zeros((48, 64, 3), np.uint8), Hints())
    assert network_of(unidepth).seen[1] is None
    assert found.intrinsics is not None
    assert (found.intrinsics.cx, found.intrinsics.cy, found.intrinsics.fx) == (31.5, 23.5, 400.0)
    assert found.intrinsics.source == "UniDepth V2"


def test_a_default_camera_is_not_passed_to_backends(unidepth: UniDepth) -> None:
    camera = Intrinsics(500.0, 500.0, 31.5, 23.5, 64, 48, "60 degrees", CameraTrust.GUESSED)
    found = unidepth.infer(np.zeros((48, 64, 3), np.uint8), Hints(intrinsics=camera))
    assert found.intrinsics is not None
    assert found.intrinsics.fx == 400


def test_the_given_camera_is_not_written_into(unidepth: UniDepth) -> None:
    camera = Intrinsics(500.0, 500.0, 31.5, 23.5, 64, 48)
    for _ in range(2):
        unidepth.infer(np.zeros((48, 64, 3), np.uint8), Hints(intrinsics=camera))
        np.testing.assert_allclose(network_of(unidepth).seen[1][0, 0, 2], 32.0)


def test_depth_that_is_not_finite_is_unknown_and_prints_stay_away(
    unidepth: UniDepth, capsys: pytest.CaptureFixture[str]
) -> None:
    depth = unidepth.infer(np.zeros((48, 64, 3), np.uint8), Hints()).depth
    assert np.isnan(depth[0, 0])
    assert (depth[1:] == 3).all()
    assert capsys.readouterr().out == ""


def test_settings_reach_unidepths_network(unidepth: UniDepth) -> None:
    assert network_of(unidepth).resolution_level == 9
    assert network_of(unidepth).interpolation_mode == "bilinear"


@pytest.fixture
def moge(stub: Callable[..., Path], tmp_path: Path) -> Moge1:
    checkout = stub("moge", {"moge/__init__.py": "", "moge/model/v1.py": MOGE})
    torch.save({"model_config": {}, "model": {}}, tmp_path / "model.pt")
    backend = Moge1(Moge1Options(checkout=str(checkout), weights=str(tmp_path / "model.pt")))
    backend.load()
    return backend


def test_moge_is_shown_red_first_between_0_and_1(moge: Moge1) -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[:] = [255, 51, 0]
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


def test_moge_puts_points_on_the_rays_of_a_given_camera(moge: Moge1) -> None:
    camera = Intrinsics(310.0, 310.0, 38.0, 31.0, 80, 60)
    found = moge.infer(np.zeros((60, 80, 3), np.uint8), Hints(intrinsics=camera))
    assert found.intrinsics == camera
    x, y, z = found.points[40, 50]
    np.testing.assert_allclose([310 * x / z + 38, 310 * y / z + 31], [50, 40], rtol=1e-5)


class PerfectUniDepth:
    """Sees the world in the picture, as the given camera sees it."""

    def infer(self, rgb: torch.Tensor, camera: torch.Tensor | None = None) -> dict[str, torch.Tensor]:
        image = rgb.numpy().transpose(1, 2, 0)
        height, width = image.shape[:2]
        world = world_of(image)
        depth = np.full((height, width), 4.0) if world is None else world.empty_depth.astype(float)
        depth[~np.isfinite(depth)] = 300.0
        focal = 1.2 * width if world is None else world.intrinsics.fx
        if camera is not None:
            # A longer lens makes the same picture of what is farther away.
            depth = depth * float(camera[0, 0, 0]) / focal
            matrix = camera.clone()
            camera[..., :2, :] *= 0.5
        else:
            centre = (
                [width / 2, height / 2] if world is None else [world.intrinsics.cx + 0.5, world.intrinsics.cy + 0.5]
            )
            matrix = torch.tensor([[[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]]])
        return {"depth": torch.from_numpy(depth)[None, None], "intrinsics": matrix}


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


class UniDepthOnWorlds(OnWorlds, UniDepth):
    perfect_network = PerfectUniDepth


class MogeOnWorlds(OnWorlds, Moge1):
    perfect_network = PerfectMoge


@parametrize_with_checks("metric_depth", UniDepthOnWorlds)
def test_unidepth_conforms(check: Callable[[], None]) -> None:
    check()


@parametrize_with_checks("relative_pointmap", MogeOnWorlds)
def test_moge_conforms(check: Callable[[], None]) -> None:
    check()


def test_mocks_without_noise_return_the_truth() -> None:
    world = build_world("walk")
    hints: Any = Hints(intrinsics=world.intrinsics)
    depth, points = UniDepthOnWorlds(), MogeOnWorlds()
    depth.load()
    points.load()
    metric: DepthMap = depth.infer(world.empty_image, hints)
    known = np.isfinite(metric.depth) & np.isfinite(world.empty_depth)
    np.testing.assert_allclose(metric.depth[known], world.empty_depth[known], rtol=1e-5)
    relative: Pointmap = points.infer(world.empty_image, hints)
    ratio = relative.points[..., 2][relative.valid] / world.empty_depth[relative.valid]
    assert ratio.std() / ratio.mean() < 1e-3
