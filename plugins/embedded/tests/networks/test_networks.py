"""The base of backends with networks: weights, batches, and pictures on a device."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pytest
import torch
from pydantic import Field

from physic_core.errors import BackendError, WeightsMissingError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap, Hints
from physic_networks.networks import (
    NetworkBackend,
    run_in_batches,
)

PHOTO = np.random.default_rng(0).integers(0, 256, (40, 60, 3), np.uint8)


class OwnOptions(Options):
    weights: str = Field("net", description="a name or a path")


class Own(NetworkBackend, MetricDepth):
    """As the plugin of a third party: the network is one number in a file."""

    Options = OwnOptions

    def build(self, device):
        factor = float(self.file().read_text())
        return lambda inputs: factor * inputs

    def preprocess(self, image, hints):
        return image.mean(axis=-1)

    def postprocess(self, output, image, hints):
        return DepthMap(output.astype(np.float32) + 1)


@pytest.fixture
def own(tmp_path, monkeypatch):
    """The class in a package with a folder of manifests; a file of its set is in the user's
    folder.
    """
    package = ModuleType("own_plugin")
    package.__path__ = [str(tmp_path / "own_plugin")]
    (tmp_path / "own_plugin" / "weights").mkdir(parents=True)
    manifest = (
        '[net]\nsummary = "A"\nlicense = "MIT"\n[[net.files]]\npath = "net.txt"\nsource = '
        '"https://example.org/x"\n'
    )
    (tmp_path / "own_plugin" / "weights" / "net.toml").write_text(manifest)
    monkeypatch.setitem(sys.modules, "own_plugin", package)
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "mine"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return type("Own", (Own,), {"__module__": "own_plugin.depth"})


def put(tmp_path, text):
    (tmp_path / "mine" / "net").mkdir(parents=True, exist_ok=True)
    (tmp_path / "mine" / "net" / "net.txt").write_text(text)


def test_weights_are_found_by_the_manifest_of_the_package(own, tmp_path):
    backend = own()
    assert "physic weights fetch net" in backend.missing()[0]
    assert backend.fingerprint() == ""
    with pytest.raises(WeightsMissingError):
        backend.load()
    put(tmp_path, "2")
    assert backend.missing() == ()
    assert backend.fingerprint() != ""


def test_a_backend_is_preprocess_network_and_postprocess(own, tmp_path):
    put(tmp_path, "2")
    backend = own()
    with pytest.raises(BackendError, match="call load"):
        backend.infer(PHOTO, Hints())
    backend.load()
    np.testing.assert_allclose(backend(PHOTO).depth, 2 * PHOTO.mean(axis=-1) + 1, rtol=1e-6)
    backend.close()
    with pytest.raises(BackendError, match="call load"):
        backend.infer(PHOTO, Hints())


@pytest.mark.parametrize("full", [False, True])
def test_batches_are_joined_in_order(full):
    sizes = []

    def call(part):
        sizes.append(len(part["x"]))
        return [2 * part["x"], torch.from_numpy(part["x"][:, 0])]

    x = np.arange(10, dtype=np.float32).reshape(5, 2)
    doubled, first = run_in_batches(call, {"x": x}, 2, full=full)
    np.testing.assert_array_equal(doubled, 2 * x)
    np.testing.assert_array_equal(first, x[:, 0])
    assert sizes == ([2, 2, 2] if full else [2, 2, 1])


def test_a_network_that_does_not_keep_its_batch_is_an_error():
    with pytest.raises(BackendError, match="batch"):
        run_in_batches(lambda part: [part["x"][:1]], {"x": np.zeros((3, 2))}, 3)
