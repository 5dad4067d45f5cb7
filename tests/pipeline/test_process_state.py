"""A backend cannot change the numbers of others by the state of the process: it is restored, and
the backend named.
"""

from __future__ import annotations

import json
import logging
import os
import random
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from PIL import Image, ImageFile

from physic_core import reconstruct
from physic_core.configuration.resolve import ResolvedBackend
from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, MetricDepthRequest
from physic_core.pipeline.stage_runner import StageRunner, load_backend
from physic_core.types import DepthMap, Hints, Provenance
from physic_mock.backends import MockSegmenter

SHAPE = (6, 8)


@dataclass(frozen=True)
class Deed:
    """A change of the process, the words of the warning about it, and what shows it."""

    words: str
    do: Callable[[], object]
    probe: Callable[[], Any]


def attribute(words, owner, name, value):
    return Deed(words, lambda: setattr(owner, name, value), lambda: getattr(owner, name))


def round_up():
    import ctypes

    ctypes.CDLL(None).fesetround(0x800 if os.uname().machine == "x86_64" else 0x400000)


def enter(context):
    """Enter a context that is never left; torch ends some of them when they are collected."""
    context.__enter__()
    HELD.append(context)


def product():
    """A product in float32, whose bits show torch's precision, threads aside."""
    values = torch.linspace(0, 1, 256 * 256).reshape(256, 256)
    return (values @ values).numpy().tobytes()


HELD = []
CUDNN = torch.backends.cudnn

DEEDS = {
    "default_dtype": Deed(
        "torch's default dtype (torch.float32 -> torch.float64)",
        lambda: torch.set_default_dtype(torch.float64),
        torch.get_default_dtype,
    ),
    "default_device": Deed(
        "torch's default device (cpu -> meta)",
        lambda: torch.set_default_device("meta"),
        lambda: torch.zeros(1).device,
    ),
    "device_context": Deed(
        "torch's default device (cpu -> meta)",
        lambda: enter(torch.device("meta")),
        lambda: torch.zeros(1).device,
    ),
    "new_precision": Deed(
        "torch's float32 precision",
        lambda: setattr(torch.backends.mkldnn.matmul, "fp32_precision", "bf16"),
        lambda: (torch.backends.mkldnn.matmul.fp32_precision, product()),
    ),
    "torch_load": attribute("torch.load", torch, "load", None),
    "gradients": Deed(
        "torch's gradient mode", lambda: torch.set_grad_enabled(False), torch.is_grad_enabled
    ),
    "inference_mode": Deed(
        "torch's inference mode",
        lambda: enter(torch.inference_mode()),
        torch.is_inference_mode_enabled,
    ),
    "threads": Deed("torch's threads", lambda: torch.set_num_threads(7), torch.get_num_threads),
    "autocast": Deed(
        "torch's autocast",
        lambda: torch.set_autocast_enabled("cpu", True),
        lambda: (torch.is_autocast_enabled("cpu"), product()),
    ),
    "matmul": Deed(
        "torch's matmul precision (highest -> medium)",
        lambda: torch.set_float32_matmul_precision("medium"),
        lambda: (torch.get_float32_matmul_precision(), product()),
    ),
    "tf32": attribute("torch's matmul precision", torch.backends.cuda.matmul, "allow_tf32", True),
    "deterministic": Deed(
        "torch's deterministic algorithms",
        lambda: torch.use_deterministic_algorithms(True),
        torch.are_deterministic_algorithms_enabled,
    ),
    "benchmark": attribute("cuDNN's `benchmark`", CUDNN, "benchmark", True),
    "cudnn_deterministic": attribute("cuDNN's `deterministic`", CUDNN, "deterministic", True),
    "onednn": attribute("oneDNN's `enabled`", torch.backends.mkldnn, "enabled", False),
    "attention": Deed(
        "torch's kernels of attention",
        lambda: torch.backends.cuda.enable_math_sdp(False),
        torch.backends.cuda.math_sdp_enabled,
    ),
    "subnormals": Deed(
        "rounding of floats",
        lambda: torch.set_flush_denormal(True),
        lambda: (sys.float_info.min / 2, (torch.full((1,), 1e-39) / 2).item()),
    ),
    "rounding": Deed("rounding of floats", round_up, lambda: float("1") + 1e-17),
    "torch_seed": Deed(
        "torch's seed",
        lambda: torch.manual_seed(0),
        lambda: torch.get_rng_state().numpy().tobytes(),
    ),
    "numpy_errors": Deed("numpy's treatment of errors", lambda: np.seterr(all="raise"), np.geterr),
    "numpy_load": attribute("numpy.load", np, "load", None),
    "numpy_generator": Deed(
        "numpy's random generator",
        lambda: np.random.set_bit_generator(np.random.PCG64(1)),
        lambda: (np.random.get_bit_generator(), np.random.get_state(legacy=False)["state"]["pos"]),
    ),
    "numpy_seed": Deed(
        "numpy's random generator",
        lambda: np.random.seed(0),
        lambda: np.random.get_state(legacy=False)["state"]["pos"],
    ),
    "opencv_threads": Deed("OpenCV's threads", lambda: cv2.setNumThreads(7), cv2.getNumThreads),
    "large_photos": attribute("Pillow's limit of pixels", Image, "MAX_IMAGE_PIXELS", None),
    "cut_photos": attribute(
        "Pillow's treatment of truncated files", ImageFile, "LOAD_TRUNCATED_IMAGES", True
    ),
    "warnings_raise": Deed(
        "warning filters",
        lambda: warnings.simplefilter("error", FutureWarning),
        lambda: list(warnings.filters),
    ),
    "warnings_off": Deed(
        "warning filters", lambda: warnings.simplefilter("ignore"), lambda: list(warnings.filters)
    ),
    "warnings_reset": Deed(
        "warning filters", warnings.resetwarnings, lambda: list(warnings.filters)
    ),
    "logs_off": Deed(
        "the level of logs",
        lambda: logging.disable(logging.ERROR),
        lambda: logging.root.manager.disable,
    ),
    "root_level": Deed(
        "the level of logs",
        lambda: logging.root.setLevel(logging.DEBUG),
        lambda: logging.getLogger().level,
    ),
    "variable": Deed(
        "the environment (OMP_NUM_THREADS, SECRET)",
        lambda: os.environ.update(OMP_NUM_THREADS="13", SECRET="s3cret"),
        lambda: dict(os.environ),
    ),
    "variable_gone": Deed(
        "the environment (PATH)", lambda: os.environ.pop("PATH"), lambda: dict(os.environ)
    ),
    "folder": Deed("the current folder", lambda: os.chdir("/"), os.getcwd),
    "random": Deed("the generator of `random`", lambda: random.seed(0), random.getstate),
}


class Naughty(MetricDepth):
    """Does something in one of its methods, and returns depths of 1 m."""

    def __init__(
        self,
        where="",
        do=lambda: None,
        error=None,
    ):
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


@pytest.fixture(autouse=True)
def settings_of_the_test():
    """Seed the generators, since a deed that leaves them as they are would not show."""
    torch.manual_seed(1)
    np.random.seed(1)
    random.seed(1)


def run(backend):
    stages = StageRunner("cpu", 1)
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
@pytest.mark.parametrize("name", DEEDS)
def test_what_a_backend_changes_is_restored_and_named(name, where):
    deed = DEEDS[name]
    before = deed.probe()
    (warning,) = run(Naughty(where, deed.do)).warnings
    assert deed.probe() == before
    assert deed.words in warning
    assert "metric_depth 'naughty' (my-dist 1.0)" in warning
    assert "s3cret" not in warning


GPU_DEEDS = {
    "seed": Deed(
        "torch's random generators of GPUs",
        lambda: torch.cuda.manual_seed(7),
        lambda: torch.cuda.get_rng_state().tolist(),
    ),
}


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
@pytest.mark.parametrize("name", GPU_DEEDS)
def test_what_a_backend_changes_of_the_gpu_is_restored_and_named(name):
    deed = GPU_DEEDS[name]
    before = deed.probe()
    (warning,) = run(Naughty("infer", deed.do)).warnings
    assert deed.probe() == before
    assert deed.words in warning


@pytest.mark.parametrize("where", ["load", "infer"])
def test_the_state_is_restored_after_an_error_too(where):
    (warning,) = run(Naughty(where, lambda: np.seterr(all="raise"), ValueError("no"))).warnings
    assert "numpy's treatment of errors" in warning
    assert np.geterr()["divide"] == "warn"


def test_a_network_that_draws_its_first_weights_while_it_loads_costs_no_warning():
    before = torch.get_rng_state()
    assert run(Naughty("load", lambda: torch.nn.Linear(3, 3))).warnings == []
    assert torch.equal(torch.get_rng_state(), before)


def test_a_filter_for_one_kind_of_warning_stays():
    with warnings.catch_warnings():
        assert (
            run(
                Naughty("infer", lambda: warnings.filterwarnings("ignore", "as of my library"))
            ).warnings
            == []
        )
        assert any(
            one[1] is not None and one[1].pattern == "as of my library" for one in warnings.filters
        )


def test_a_backend_that_is_loaded_alone_says_what_it_changed(monkeypatch, caplog):
    monkeypatch.setattr(
        Naughty, "__init__", lambda self, options=None: MetricDepth.__init__(self, options)
    )
    monkeypatch.setattr(Naughty, "load", lambda self, device: np.seterr(all="raise"))
    monkeypatch.setattr(Naughty, "written_for", 1, raising=False)
    load_backend("metric_depth", f"{__name__}:Naughty")
    assert "numpy's treatment of errors" in caplog.text
    assert np.geterr()["divide"] == "warn"


@pytest.mark.usefixtures("few_steps")
def test_a_run_beside_a_naughty_segmenter_has_the_same_numbers(world):
    deeds = [
        deed
        for name, deed in DEEDS.items()
        if name not in ("inference_mode", "default_device", "device_context")
    ]

    class Segmenter(MockSegmenter):
        def infer(self, *arguments):
            found = super().infer(*arguments)
            for deed in deeds:
                deed.do()
            return found

    honest = reconstruct(world.image, "mock")
    found = reconstruct(world.image, "mock", backends={"segmenter": Segmenter})
    (warning,) = (text for text in found.warnings if text not in honest.warnings)
    assert all(deed.words.partition(" (")[0] in warning for deed in deeds)
    assert found.people[0].vertices.tobytes() == honest.people[0].vertices.tobytes()


PLUGIN = """
from physic_mock.backends import MockSegmenter

class Lazy(MockSegmenter):
    def load(self, device="cpu"):
        import cv2, torch
        torch.set_float32_matmul_precision("medium")
        cv2.setNumThreads(0)
        super().load(device)
"""


@pytest.mark.slow
def test_a_library_that_a_backend_imports_first_is_compared_with_its_defaults(world, tmp_path):
    """In a new process, whose imports set variables and filters, which are no change."""
    (tmp_path / "lazy_plugin.py").write_text(PLUGIN)
    Image.fromarray(world.image).save(tmp_path / "world.png")
    command = [
        *(
            sys.executable,
            "-m",
            "physic_core",
            "run",
            "world.png",
            "--preset",
            "mock",
            "--save",
            "numbers",
        )
    ]
    lazy = ["--set", "segmenter.backend=lazy_plugin:Lazy"]
    found = []
    for more in ([], lazy):
        subprocess.run(
            [*command, "--out", "out", "--overwrite", *more],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            check=True,
            capture_output=True,
        )
        found.append(json.loads((tmp_path / "out" / "reconstruction.json").read_text())["warnings"])
    honest, (warning, *_) = found
    assert not any("whole process" in text for text in honest)
    assert "torch's matmul precision (highest -> medium)" in warning
    assert "OpenCV's threads" in warning
    assert "environment" not in warning
