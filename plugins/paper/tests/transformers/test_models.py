"""Folders, names and caches of models; what is missing; what is refused."""

from __future__ import annotations

import inspect
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from physic_core import weights
from physic_core.errors import BackendError, DeviceError
from physic_core.types import Hints
from physic_transformers import models
from physic_transformers.depth_pro import DepthPro, DepthProOptions
from physic_transformers.grounded_sam2 import GroundedSam2, GroundedSam2Options
from physic_transformers.sam3 import Sam3, Sam3Options

BACKENDS = (GroundedSam2, Sam3, DepthPro)
GREY = np.full((60, 80, 3), 128, np.uint8)


def test_a_model_is_found_by_its_name_in_a_folder_of_weights(saved, tmp_path):
    name = DepthProOptions().weights
    backend = DepthPro()
    (problem,) = backend.missing()
    assert f"physic weights fetch {name}" in problem
    shutil.copytree(saved("depth_pro"), tmp_path / "weights" / name)
    assert backend.missing() == ()
    backend.load()
    backend.infer(GREY, Hints())


def test_a_folder_without_a_model_is_refused(tmp_path):
    with pytest.raises(BackendError, match=r"config\.json"):
        Sam3(Sam3Options(weights=str(tmp_path))).load()


@pytest.mark.parametrize("kind", BACKENDS)
def test_every_default_is_in_the_list_of_weights(kind):
    known = weights.read_manifest(kind.manifest())
    backend = kind()
    for spec in kind.specs:
        files = {file.path for file in known[getattr(backend.options, spec.option)].files}
        assert {"config.json", "model.safetensors"} <= files
        assert ("tokenizer.json" in files) == spec.needs_tokenizer


def test_a_model_of_another_type_is_refused(saved):
    folder = saved("sam2")
    with pytest.raises(BackendError, match="type 'sam2'"):
        DepthPro(DepthProOptions(weights=str(folder))).load()


def test_incomplete_weights_are_refused_and_never_initialised_randomly(saved, tmp_path):
    from safetensors.numpy import load_file, save_file

    folder = Path(shutil.copytree(saved("depth_pro"), tmp_path / "torn"))
    tensors = load_file(folder / "model.safetensors")
    torn = sorted(name for name in tensors if name.startswith("head."))[-2:]
    for name in torn:
        del tensors[name]
    save_file(tensors, folder / "model.safetensors", {"format": "pt"})
    absent = re.escape(f"2 are expected and not found ({', '.join(torn)})")
    with pytest.raises(BackendError, match=absent):
        DepthPro(DepthProOptions(weights=str(folder))).load()


def test_weights_of_another_size_are_refused(saved, tmp_path):
    folder = Path(shutil.copytree(saved("depth_pro"), tmp_path / "other"))
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "fusion_hidden_size": 6}))
    with pytest.raises(BackendError, match="cannot be read as DepthPro"):
        DepthPro(DepthProOptions(weights=str(folder))).load()


def test_half_precision_is_refused_on_a_cpu_and_bfloat16_is_not(saved):
    folder = str(saved("depth_pro"))
    with pytest.raises(DeviceError, match="'float16' needs a GPU"):
        DepthPro(DepthProOptions(weights=folder, precision="float16")).load()
    backend = DepthPro(DepthProOptions(weights=folder, precision="bfloat16"))
    backend.load()
    assert backend.model()._model.dtype.itemsize == 2
    assert backend.infer(GREY, Hints()).depth.dtype == np.float32


def test_nothing_is_learnt_and_nothing_is_drawn_on_the_screen(saved, capfd):
    import torch
    from transformers.utils import logging

    bars = logging.is_progress_bar_enabled()
    level = logging.get_verbosity()
    options = GroundedSam2Options(
        detector=str(saved("grounding_dino")), masks=str(saved("sam2_video"))
    )
    backend = GroundedSam2(options)
    capfd.readouterr()
    backend.load()
    backend.infer(GREY)
    assert capfd.readouterr() == ("", "")
    assert (logging.is_progress_bar_enabled(), logging.get_verbosity()) == (bars, level)
    assert not backend.model("masks")._model.training
    assert torch.is_grad_enabled()


@pytest.mark.parametrize(
    ("kind", "network", "prefix"),
    [("sam2", "Sam2Model", ""), ("sam3", "Sam3Model", "detector_model.")],
)
def test_networks_for_photos_are_read_from_the_published_ones_for_videos(
    saved, kind, network, prefix
):
    from safetensors.numpy import load_file

    folder = saved(f"{kind}_video")
    assert json.loads((folder / "config.json").read_text())["model_type"] == f"{kind}_video"
    spec = models.ModelSpec("weights", network, (kind, f"{kind}_video"))
    own = models.open_model(spec, folder, models.ModelOptions(), "cpu")._model.state_dict()
    published = load_file(folder / "model.safetensors")
    assert len(own) < len(published)
    for name, tensor in own.items():
        np.testing.assert_array_equal(tensor.numpy(), published[prefix + name])


@pytest.mark.parametrize("spec", [spec for kind in BACKENDS for spec in kind.specs])
def test_networks_that_sample_grids_are_named(spec):
    import transformers

    network = getattr(transformers, spec.class_name)
    code = Path(inspect.getfile(network)).read_text(encoding="utf-8")
    assert spec.samples_grids == ("grid_sample" in code)


def test_networks_that_sample_grids_compute_in_float32_on_a_cpu(saved):
    """torch's CPU fills NaN into grid_sample in half precision, by what is in memory."""
    spec, _ = GroundedSam2.specs
    options = models.ModelOptions(precision="bfloat16")
    network = models.open_model(spec, saved("grounding_dino"), options, "cpu")
    words = np.array([[1, 5, 4, 2]])
    answer = network.run(
        pixel_values=np.zeros((1, 3, 64, 96), np.float32),
        pixel_mask=np.ones((1, 64, 96), np.int64),
        input_ids=words,
        token_type_ids=np.zeros_like(words),
        attention_mask=np.ones_like(words),
    )
    assert str(answer.logits.dtype) == "torch.float32"
