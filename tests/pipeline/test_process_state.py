"""A backend cannot change the numbers of others by the state of the process: it is restored, and
the backend named.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from physic_core.configuration.resolve import ResolvedBackend
from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, MetricDepthRequest
from physic_core.pipeline.stage_caller import StageCaller, load_backend
from physic_core.types import DepthMap, Hints, Provenance

SHAPE = (6, 8)


def change_all():
    """Change what a backend may leave changed."""
    torch.set_default_dtype(torch.float64)
    torch.set_num_threads(7)
    cv2.setNumThreads(7)
    os.environ.update(OMP_NUM_THREADS="13", SECRET="s3cret")
    os.environ.pop("PATH")
    os.chdir("/")


def state():
    threads = torch.get_num_threads(), cv2.getNumThreads()
    return torch.get_default_dtype(), threads, dict(os.environ), os.getcwd()


WORDS = (
    "torch's default dtype (torch.float32 -> torch.float64)",
    "torch's threads",
    "OpenCV's threads",
    "the environment (OMP_NUM_THREADS, PATH, SECRET)",
    "the current folder",
)


class Naughty(MetricDepth):
    """Does something in one of its methods, and returns depths of 1 m."""

    def __init__(self, where, do, error=None):
        super().__init__()
        self.where = where
        self.do = do
        self.error = error

    def load(self, device="cpu"):
        self.act("load")

    def infer(self, image, hints):
        self.act("infer")
        return DepthMap(np.ones(SHAPE, np.float32))

    def close(self):
        self.act("close")

    def act(self, where):
        if where == self.where:
            self.do()
            if self.error is not None:
                raise self.error


def run(backend):
    stages = StageCaller("cpu", 1)
    who = ResolvedBackend(
        backend, Provenance("metric_depth", "naughty", "p", "my-dist", "1.0", {}, "")
    )
    try:
        stages.call_backend(
            "depth", who, MetricDepthRequest(np.zeros((*SHAPE, 3), np.uint8), Hints())
        )
    except BackendError:
        assert backend.error is not None
    stages.close()
    return stages


@pytest.mark.parametrize("where", ["load", "infer", "close"])
def test_what_a_backend_changes_is_restored_and_named(where):
    before = state()
    (warning,) = run(Naughty(where, change_all)).warnings
    assert state() == before
    assert warning.startswith("metric_depth 'naughty' (my-dist 1.0)")
    assert all(words in warning for words in WORDS)
    assert "s3cret" not in warning


@pytest.mark.parametrize("where", ["load", "infer"])
def test_the_state_is_restored_after_an_error_too(where):
    (warning,) = run(Naughty(where, lambda: cv2.setNumThreads(7), ValueError("no"))).warnings
    assert "OpenCV's threads" in warning


def test_a_backend_that_is_loaded_alone_says_what_it_changed(monkeypatch, caplog):
    monkeypatch.setattr(
        Naughty, "__init__", lambda self, options=None: MetricDepth.__init__(self, options)
    )
    monkeypatch.setattr(Naughty, "load", lambda self, device: cv2.setNumThreads(7))
    monkeypatch.setattr(Naughty, "written_for", 1, raising=False)
    load_backend("metric_depth", f"{__name__}:Naughty")
    assert "OpenCV's threads" in caplog.text


PLUGIN = """
from physic_mock.backends import MockSegmenter

class Lazy(MockSegmenter):
    def load(self, device="cpu"):
        import cv2, torch
        torch.set_default_dtype(torch.float64)
        cv2.setNumThreads(0)
        super().load(device)
"""


@pytest.mark.slow
def test_a_library_that_a_backend_imports_first_is_compared_with_its_defaults(world, tmp_path):
    """In a new process, whose imports set variables and filters, which are no change."""
    (tmp_path / "lazy_plugin.py").write_text(PLUGIN)
    Image.fromarray(world.image).save(tmp_path / "world.png")
    words = "-m physic_core run world.png --preset mock --save numbers --out out --overwrite"
    lazy = ["--set", "segmenter.backend=lazy_plugin:Lazy"]
    found = []
    for more in ([], lazy):
        subprocess.run(
            [sys.executable, *words.split(), *more],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            check=True,
            capture_output=True,
        )
        found.append(json.loads((tmp_path / "out" / "reconstruction.json").read_text())["warnings"])
    honest, (warning, *_) = found
    assert not any("whole process" in text for text in honest)
    assert "torch's default dtype (torch.float32 -> torch.float64)" in warning
    assert "OpenCV's threads" in warning
    assert "environment" not in warning
