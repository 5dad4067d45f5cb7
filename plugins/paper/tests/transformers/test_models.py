"""What is read, and what is refused."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from physic_core.errors import BackendError, DeviceError
from physic_core.types import Hints
from physic_transformers import models
from physic_transformers.depth_pro import DepthPro

GREY = np.full((60, 80, 3), 128, np.uint8)


def drop_two(folder):
    """Remove two tensors, and return their names."""
    from safetensors.numpy import load_file, save_file

    tensors = load_file(folder / "model.safetensors")
    torn = sorted(name for name in tensors if name.startswith("head."))[-2:]
    for name in torn:
        del tensors[name]
    save_file(tensors, folder / "model.safetensors", {"format": "pt"})
    return f"2 are expected and not found ({', '.join(torn)})"


def resize(folder):
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "fusion_hidden_size": 6}))
    return "cannot be read as DepthPro"


def rename(folder):
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "model_type": "sam2"}))
    return "type 'sam2'"


@pytest.mark.parametrize("change", [drop_two, resize, rename])
def test_other_weights_are_refused_and_never_initialised_randomly(saved, tmp_path, change):
    folder = Path(shutil.copytree(saved("depth_pro"), tmp_path / "other"))
    words = change(folder)
    backend = DepthPro()
    backend.file = lambda name=None, option="weights": folder
    with pytest.raises(BackendError, match=re.escape(words)):
        backend.load()


def test_half_precision_is_refused_on_a_cpu_and_bfloat16_is_not(stored):
    networks = {"weights": "depth_pro"}
    with pytest.raises(DeviceError, match="'float16' needs a GPU"):
        stored(DepthPro, networks, precision="float16").load()
    backend = stored(DepthPro, networks, precision="bfloat16")
    backend.load()
    assert backend.infer(GREY, Hints()).depth.dtype == np.float32


@pytest.mark.parametrize(
    ("kind", "network", "prefix"),
    [("sam2", "Sam2Model", ""), ("sam3", "Sam3Model", "detector_model.")],
)
def test_networks_for_photos_are_read_from_the_published_ones_for_videos(
    saved, kind, network, prefix
):
    from safetensors.numpy import load_file

    folder = saved(f"{kind}_video")
    spec = models.ModelSpec("weights", network, (kind, f"{kind}_video"))
    tensors = models.open_model(spec, folder, models.ModelOptions(), "cpu")._model.state_dict()
    published = load_file(folder / "model.safetensors")
    assert len(tensors) < len(published)
    for name, tensor in tensors.items():
        np.testing.assert_array_equal(tensor.numpy(), published[prefix + name])
