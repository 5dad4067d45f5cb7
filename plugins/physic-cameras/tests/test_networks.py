"""The classes of kornia and of Depth Anything 3, with random weights, answer the same here as called by themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from physic_cameras.depth_anything_3 import DepthAnything3Network, pictures
from physic_cameras.disk_lightglue import DISK_FILE, LIGHTGLUE_FILE, DiskLightGlue
from physic_cameras.lightglue import LightGlueCameras
from physic_core.errors import BackendError, WeightsMissingError
from physic_testing.worlds import build_world

IMAGE = build_world("stand", 1, (160, 120)).image


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of both networks as they are published: DISK beside its optimiser, LightGlue under older names."""
    from kornia.feature import DISK, LightGlue

    place = tmp_path_factory.mktemp("disk-lightglue")
    with torch.random.fork_rng():
        torch.manual_seed(0)
        disk, lightglue = DISK(), LightGlue(None, input_dim=128)
    torch.save({"extractor": disk.state_dict(), "optimizer": {}}, place / DISK_FILE)
    old = {}
    for name, tensor in lightglue.state_dict().items():
        parts = name.split(".")
        if parts[0] == "transformers":
            name = ".".join([parts[2], parts[1], *parts[3:]])
        if name != "confidence_thresholds":
            old[name] = tensor
    torch.save(old, place / LIGHTGLUE_FILE)
    return place


def test_features_and_matches_are_those_of_kornia(folder: Path) -> None:
    from kornia.feature import DISK, LightGlueMatcher, laf_from_center_scale_ori

    network = DiskLightGlue(folder, "cpu", longest_px=1024, features=100)
    one, two = network.features(IMAGE), network.features(np.ascontiguousarray(IMAGE[:, ::-1]))
    disk = DISK()
    disk.load_state_dict(torch.load(folder / DISK_FILE, weights_only=True)["extractor"])
    pixels = torch.from_numpy(IMAGE.transpose(2, 0, 1).copy()).float()[None] / 255
    with torch.inference_mode():
        own = disk.eval()(pixels, n=100, pad_if_not_divisible=True)[0]
    np.testing.assert_array_equal(one.pixels, own.keypoints.numpy())
    np.testing.assert_allclose(one.descriptors.numpy(), own.descriptors.numpy(), atol=1e-6)

    matcher: Any = LightGlueMatcher.__new__(LightGlueMatcher)
    torch.nn.Module.__init__(matcher)
    matcher.feature_name, matcher.matcher = "disk", network._lightglue
    network._lightglue.conf.filter_threshold = 0  # scores of random weights are small
    lafs = [laf_from_center_scale_ori(torch.from_numpy(some.pixels).float()[None]) for some in (one, two)]
    with torch.inference_mode():
        _, expected = matcher(one.descriptors, two.descriptors, *lafs, hw1=(120, 160), hw2=(120, 160))
    assert len(expected)
    np.testing.assert_array_equal(network.match(one, two), expected.numpy())


def test_pixels_of_a_reduced_photo_are_those_of_the_photo(folder: Path) -> None:
    """Features lie on whole pixels of the copy, which is half as large: on the corners of four pixels of the photo."""
    features = DiskLightGlue(folder, "cpu", longest_px=80, features=100).features(IMAGE)
    np.testing.assert_allclose(features.pixels % 2, 0.5)
    assert features.size == (160, 120)


def test_no_features_give_no_matches(folder: Path) -> None:
    network = DiskLightGlue(folder, "cpu", longest_px=160, features=100)
    features = network.features(IMAGE)
    assert network.match(features, features.where(np.zeros(len(features.pixels), bool))).shape == (0, 2)


def test_files_of_other_networks_are_refused(folder: Path, tmp_path: Path) -> None:
    exchanged = {DISK_FILE: LIGHTGLUE_FILE, LIGHTGLUE_FILE: DISK_FILE}
    for name, other in exchanged.items():
        (tmp_path / name).write_bytes((folder / other).read_bytes())
    with pytest.raises(BackendError, match=r"is not a checkpoint of DISK: .* tensors are missing"):
        DiskLightGlue(tmp_path, "cpu", longest_px=160, features=100)
    (tmp_path / DISK_FILE).write_bytes(b"no checkpoint")
    with pytest.raises(BackendError, match="cannot be read as a checkpoint of torch"):
        DiskLightGlue(tmp_path, "cpu", longest_px=160, features=100)


def test_missing_weights_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path))
    with pytest.raises(WeightsMissingError, match="disk-lightglue"):
        LightGlueCameras().load()


@pytest.mark.parametrize(
    ("sizes", "shape", "before"),
    [
        ([(480, 640), (480, 640)], (378, 504), [(504, 378)] * 2),
        ([(640, 480), (480, 640)], (378, 378), [(378, 504), (504, 378)]),
        ([(1000, 1000)], (504, 504), [(504, 504)]),
        ([(301, 500)], (308, 504), [(504, 308)]),
    ],
)
def test_photos_are_reduced_and_cropped_as_by_the_authors(
    sizes: list[tuple[int, int]], shape: tuple[int, int], before: list[tuple[int, int]]
) -> None:
    pixels, found = pictures([np.zeros((*size, 3), np.uint8) for size in sizes], 504)
    assert pixels.shape == (len(sizes), 3, *shape)
    assert found == before
    np.testing.assert_allclose(pixels[0, :, 0, 0], -np.array([0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225], rtol=1e-5)


@pytest.mark.filterwarnings("ignore:register_new_resolver", "ignore::DeprecationWarning")  # in the authors' package
def test_poses_are_those_of_the_authors_network(tmp_path: Path) -> None:
    pytest.importorskip("depth_anything_3", reason="Depth Anything 3 is not installed")
    from depth_anything_3.cfg import create_object, load_config
    from depth_anything_3.registry import MODEL_REGISTRY
    from safetensors.torch import save_file, save_model

    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = create_object(load_config(MODEL_REGISTRY["da3-small"])).eval()
    path = tmp_path / "model.safetensors"
    save_model(torch.nn.ModuleDict({"model": network}), str(path))  # tensors with several names are in the file once
    pixels, _ = pictures([IMAGE, np.ascontiguousarray(IMAGE[:, ::-1]), IMAGE // 2], 112)
    poses, matrices = DepthAnything3Network(path, "da3-small", "cpu")(pixels)
    with torch.inference_mode():
        expected = network(torch.from_numpy(pixels)[None])
    np.testing.assert_allclose(poses, expected.extrinsics[0].numpy(), atol=1e-5)
    np.testing.assert_allclose(matrices, expected.intrinsics[0].numpy(), rtol=1e-3)
    save_file({"model.backbone.x": torch.zeros(1)}, path)
    with pytest.raises(BackendError, match=r"is not a checkpoint of DepthAnything3Net: .* tensors are missing"):
        DepthAnything3Network(path, "da3-small", "cpu")
