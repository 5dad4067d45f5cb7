"""Folders, names and caches of models; what is missing; what is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from physic_core.errors import BackendError, DeviceError, WeightsMissingError
from physic_core.types import Hints
from physic_transformers.depth_anything import (
    DepthAnythingMetric,
    DepthAnythingRelative,
    MetricOptions,
    RelativeOptions,
)
from physic_transformers.depth_pro import DepthPro, DepthProOptions
from physic_transformers.grounded_sam2 import GroundedSam2

if TYPE_CHECKING:
    from collections.abc import Callable
GREY = np.full((60, 80, 3), 128, np.uint8)


@pytest.fixture(autouse=True)
def _own_places(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither the user's weights nor the network are for the tests."""
    from huggingface_hub import constants

    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "weights"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))


def in_hub_cache(folder: Path, cache: Path, repository: str) -> None:
    """Put a model where huggingface_hub would have put it."""
    place = cache / f"models--{repository.replace('/', '--')}"
    shutil.copytree(folder, place / "snapshots" / "0123abcd")
    (place / "refs").mkdir()
    (place / "refs" / "main").write_text("0123abcd")


def test_a_model_is_found_by_its_folder(saved: Callable[..., Path]) -> None:
    backend = DepthAnythingMetric(MetricOptions(weights=str(saved("depth_anything"))))
    assert backend.missing() == ()
    backend.load()
    assert backend.infer(GREY, Hints()).depth.shape == (60, 80)


def test_a_model_is_found_by_its_name_in_a_folder_of_weights(saved: Callable[..., Path], tmp_path: Path) -> None:
    name = MetricOptions().weights
    backend = DepthAnythingMetric()
    told = f"weights '{name}' (Apache-2.0) are missing: `physic weights fetch {name}`"
    assert backend.missing() == (told,)
    shutil.copytree(saved("depth_anything"), tmp_path / "weights" / name)
    assert backend.missing() == ()
    backend.load()
    backend.infer(GREY, Hints())


def test_a_model_is_found_by_its_name_in_the_cache_of_the_hub(saved: Callable[..., Path], tmp_path: Path) -> None:
    repository = "depth-anything/Depth-Anything-V2-Metric-Indoor-Small-hf"
    in_hub_cache(saved("depth_anything"), tmp_path / "hub", repository)
    DepthAnythingMetric().load()


def test_a_repository_that_is_not_cached_is_not_fetched() -> None:
    backend = DepthAnythingMetric(MetricOptions(weights="somebody/finetuned"))
    told = (
        "'somebody/finetuned' is no folder here, and Hugging Face's cache does not hold it; nothing is fetched while a "
        "photo is reconstructed: run `hf download somebody/finetuned` first, or give a folder"
    )
    assert backend.missing() == (told,)
    assert backend.fingerprint() == ""
    with pytest.raises(WeightsMissingError) as error:
        backend.load()
    assert str(error.value) == told


def test_every_missing_network_of_a_backend_is_named() -> None:
    told = GroundedSam2().missing()
    assert [text.split("'")[1] for text in told] == ["grounding-dino-base-hf", "sam2.1-hiera-large-hf"]


def test_a_model_of_another_type_is_refused(saved: Callable[..., Path]) -> None:
    folder = saved("eomt")
    with pytest.raises(BackendError) as error:
        DepthPro(DepthProOptions(weights=str(folder))).load()
    assert str(error.value) == (
        f"{folder} holds a model of the type 'eomt', expected 'depth_pro' for DepthProForDepthEstimation"
    )


def test_incomplete_weights_are_refused_and_never_initialised_randomly(
    saved: Callable[..., Path], tmp_path: Path
) -> None:
    from safetensors.numpy import load_file, save_file

    folder = Path(shutil.copytree(saved("depth_anything"), tmp_path / "torn"))
    tensors = load_file(folder / "model.safetensors")
    del tensors["head.conv1.weight"], tensors["head.conv1.bias"]
    save_file(tensors, folder / "model.safetensors", {"format": "pt"})
    with pytest.raises(BackendError) as error:
        DepthAnythingMetric(MetricOptions(weights=str(folder))).load()
    assert str(error.value) == (
        f"{folder} has not all weights of DepthAnythingForDepthEstimation: 2 are expected and not found "
        "(head.conv1.bias, head.conv1.weight); it is another model, or of another version"
    )


def test_weights_of_another_size_are_refused(saved: Callable[..., Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(saved("depth_anything"), tmp_path / "other"))
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "head_hidden_size": 6}))
    with pytest.raises(BackendError, match="cannot be read as DepthAnythingForDepthEstimation: "):
        DepthAnythingMetric(MetricOptions(weights=str(folder))).load()


def test_metric_weights_are_refused_for_relative_depth(saved: Callable[..., Path]) -> None:
    with pytest.raises(BackendError, match="are metric, expected relative ones: they are for the metric_depth"):
        DepthAnythingRelative(RelativeOptions(weights=str(saved("depth_anything", "metric")))).load()
    with pytest.raises(BackendError, match="are relative, expected metric ones: they are for the relative_pointmap"):
        DepthAnythingMetric(MetricOptions(weights=str(saved("depth_anything", "relative")))).load()


def test_a_gpu_that_is_not_there_is_refused_before_anything_is_read() -> None:
    with pytest.raises(DeviceError):
        DepthPro().load("cuda:99")


def test_the_fingerprint_changes_with_the_files_and_not_with_their_place(
    saved: Callable[..., Path], tmp_path: Path
) -> None:
    folder = saved("depth_anything")
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    prints = [DepthAnythingMetric(MetricOptions(weights=str(path))).fingerprint() for path in (folder, copy)]
    assert prints[0] == prints[1] != ""
    (copy / "config.json").write_text((copy / "config.json").read_text() + "\n")
    assert DepthAnythingMetric(MetricOptions(weights=str(copy))).fingerprint() != prints[0]
