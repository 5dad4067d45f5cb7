"""The lock file: what is fetched first is pinned, and what differs from it is named."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from physic_core import reconstruct
from physic_core.errors import WeightsMissingError
from physic_core.interfaces import MetricDepth, Repository
from physic_core.types import DepthMap
from physic_core.weights import locate, read_manifest
from physic_core.weights.lock import locked, read_lock, recorded_uses
from physic_setup.fetch import fetch
from physic_setup.pins import pin
from physic_testing.worlds import load_world

pytestmark = pytest.mark.quick

NAME = "net/model.onnx"


@pytest.fixture
def manifest(lists, tmp_path, monkeypatch):
    """A set whose file is here, without a SHA-256; the lock file is physic.lock of the current
    folder.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PHYSIC_LOCK", str(tmp_path / "physic.lock"))
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "mine"))
    (tmp_path / "mine" / "net").mkdir(parents=True)
    (tmp_path / "mine" / "net" / "model.onnx").write_bytes(b"one")
    return lists.add("net", {"path": "model.onnx", "source": "hf://owner/net/model.onnx"})


def use(manifest):
    with recorded_uses() as uses:
        locate(manifest, "net")
    return dict(uses[NAME])


def test_fetch_pins_what_the_manifest_does_not(manifest):
    digest = hashlib.sha256(b"one").hexdigest()
    assert use(manifest) == {"sha256": digest, "state": "unpinned"}
    assert fetch(read_manifest(manifest)["net"]) == ()
    assert read_lock() == {NAME: {"sha256": digest}}
    assert use(manifest)["state"] == "locked"
    (file,) = locked(read_manifest(manifest)["net"]).files
    assert (file.sha256, file.is_pinned) == (digest, True)


def test_another_file_is_named_and_does_not_change_the_lock(manifest):
    fetch(read_manifest(manifest)["net"])
    before = Path("physic.lock").read_text()
    Path("mine/net/model.onnx").write_bytes(b"other")
    assert use(manifest) == {"sha256": hashlib.sha256(b"other").hexdigest(), "state": "differs"}
    fetch(read_manifest(manifest)["net"])
    assert Path("physic.lock").read_text() == before


def test_a_revision_of_the_lock_is_the_one_that_is_fetched(manifest):
    pin({NAME: {"sha256": "0" * 64, "revision": "a" * 40}})
    (file,) = locked(read_manifest(manifest)["net"]).files
    assert file.source == f"hf://owner/net/model.onnx@{'a' * 40}"
    pin({NAME: {"sha256": "1" * 64}})
    assert read_lock()[NAME]["sha256"] == "0" * 64, "the first stays"


def test_a_published_hash_needs_no_lock(lists, tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSIC_LOCK", str(tmp_path / "physic.lock"))
    digest = hashlib.sha256(b"one").hexdigest()
    manifest = lists.add(
        "net", {"path": "model.onnx", "sha256": digest, "source": "https://example.org/a"}
    )
    pin({NAME: {"sha256": "0" * 64}})
    assert locked(read_manifest(manifest)["net"]) == read_manifest(manifest)["net"]


def test_a_damaged_lock_file_is_an_error(manifest):
    Path("physic.lock").write_text("not [ toml")
    with pytest.raises(
        WeightsMissingError, match=r"physic\.lock cannot be read: .*; mend or delete it"
    ):
        read_lock()


def test_a_result_names_its_weights_and_checkouts_and_warns_of_others(manifest):
    class Depth(MetricDepth):
        def load(self, device="cpu"):
            locate(manifest, "net")

        def requirements(self):
            return (
                Repository(
                    "checkout",
                    "Thing",
                    "https://example.org/thing",
                    "b" * 40,
                    "thing",
                    "c" * 40,
                    True,
                ),
            )

        def infer(self, image, hints):
            return DepthMap(np.full(image.shape[:2], 3.0, np.float32))

    fetch(read_manifest(manifest)["net"])
    Path("mine/net/model.onnx").write_bytes(b"other")
    world = load_world("stand", (160, 120))
    config = {
        "extends": "mock",
        "run": {"cache": False},
        "engine": {"joint": {"optimiser": {"steps": 5}}},
    }
    found = reconstruct(world.image, config, backends={"metric_depth": Depth()})
    assert found.diagnostics["weights"][NAME]["state"] == "differs"
    assert found.diagnostics["repositories"] == {
        "https://example.org/thing": {"commit": "c" * 40, "state": "differs"}
    }
    lock = Path("physic.lock").absolute()
    assert f"weights {NAME} are not those of {lock}" in found.warnings
    checkout = (
        "the checkout of https://example.org/thing is at ccccccc, not at the commit that was pinned"
    )
    assert checkout in found.warnings
