"""Opening and running ONNX files: providers, types, and files that are not whole."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import onnx
import onnxruntime
import pytest

from physic_core.errors import BackendError, DeviceError
from physic_networks.onnx_sessions import select_provider
from physic_onnx.sessions import OnnxOptions, open_network

CPU = "CPUExecutionProvider"
CUDA = "CUDAExecutionProvider"
TENSORRT = "TensorrtExecutionProvider"
COREML = "CoreMLExecutionProvider"
DIRECTML = "DmlExecutionProvider"


def written(path, text):
    """An ONNX file of this text."""
    head = '<ir_version: 8, opset_import: ["" : 14]>'
    path.write_bytes(onnx.parser.parse_model(head + text).SerializeToString())
    return path


@pytest.fixture
def doubler(tmp_path):
    """A graph that answers twice its image, plus a number of another type."""

    def build(dtype="float", kind=1):
        return written(
            tmp_path / "double.onnx",
            f"doubler ({dtype}[b, 3, h, w] image, int64 count) => ({dtype}[b, 3, h, w] sum) {{"
            f" number = Cast<to={kind}>(count) twice = Add(image, image)"
            " sum = Add(twice, number) }",
        )

    return build


ONE = {"image": np.ones((1, 3, 2, 2)), "count": np.array(1)}


class TestRunning:
    def test_a_border_of_zeros_before_a_max_pool_stays_zero(self, tmp_path):
        path = written(
            tmp_path / "pool.onnx",
            "pool (float[1, 1, 4, 4] x) => (float[1, 1, 4, 4] y) <int64[8] border = "
            "{0, 0, 1, 1, 0, 0, 1, 1}> { padded = Pad(x, border)"
            " y = MaxPool<kernel_shape=[3, 3]>(padded) }",
        )
        network = open_network(path, OnnxOptions(), "cpu")
        (peaks,) = network.answer(np.full((1, 1, 4, 4), -1.0))
        assert peaks[0, 0].tolist() == [[0, 0, 0, 0], [0, -1, -1, 0], [0, -1, -1, 0], [0, 0, 0, 0]]

    @pytest.mark.parametrize(("dtype", "kind"), [("float16", 10), ("float", 1)])
    def test_floats_are_cast_to_what_the_file_takes(self, doubler, dtype, kind):
        network = open_network(doubler(dtype, kind), OnnxOptions(), "cpu")
        image = np.full((1, 3, 4, 5), 0.25)
        (answer,) = network.run({"image": image, "count": np.array(2, np.int32)}, ["sum"])
        assert answer.dtype == "float32"
        np.testing.assert_array_equal(answer, 2.5)

    @pytest.mark.parametrize(
        ("image", "words"),
        [
            (np.ones((1, 3, 2, 2), np.uint8), "takes float32, got uint8"),
            (np.ones((1, 2, 2), np.float32), r"image float32 \(1, 2, 2\)"),
            (np.full((1, 3, 2, 2), np.nan), r"output 'sum'.*without one finite number"),
        ],
    )
    def test_a_failed_run_says_why(self, doubler, image, words):
        network = open_network(doubler(), OnnxOptions(), "cpu")
        with pytest.raises(BackendError, match=words):
            network.run({**ONE, "image": image}, ["sum"])


class TestProviders:
    @pytest.mark.parametrize(
        ("name", "device", "available", "asked"),
        [
            ("auto", "cpu", [TENSORRT, CUDA, CPU], [CPU]),
            ("auto", "cuda:1", [TENSORRT, CUDA, CPU], [(CUDA, "1")]),
            ("cpu", "cuda", [CUDA, CPU], [CPU]),
            ("cuda", "cpu", [CUDA, CPU], [(CUDA, "0")]),
            ("tensorrt", "cuda:2", [TENSORRT, CUDA, CPU], [(TENSORRT, "2"), (CUDA, "2")]),
            ("coreml", "cpu", [COREML, CPU], [COREML]),
            ("directml", "cpu", [DIRECTML, CPU], [(DIRECTML, "0")]),
        ],
    )
    def test_option_and_device_choose_it(self, name, device, available, asked):
        _, settings = select_provider(name, device, available)
        assert [s if isinstance(s, str) else (s[0], s[1]["device_id"]) for s in settings] == asked

    @pytest.mark.parametrize(
        ("name", "device", "words"),
        [
            (
                "auto",
                "cuda",
                "device 'cuda' needs CUDA, .* has only 'cpu': install onnxruntime-gpu in place of",
            ),
            (
                "directml",
                "cpu",
                "is DirectML, .* install onnxruntime-directml .*, or choose provider 'cpu'",
            ),
            ("auto", "mps", "unknown device 'mps': use 'cpu', 'cuda' or 'cuda:N'"),
        ],
    )
    def test_a_missing_provider_is_refused_with_the_package_to_install(self, name, device, words):
        with pytest.raises(DeviceError, match=words):
            select_provider(name, device, ["AzureExecutionProvider", CPU])

    def test_a_provider_that_does_not_start_is_an_error_and_not_the_cpu(self, doubler, monkeypatch):
        """onnxruntime goes on with the CPU where CUDA's libraries do not fit, and raises
        nothing.
        """
        session = onnxruntime.InferenceSession
        monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: [TENSORRT, CUDA, CPU])
        monkeypatch.setattr(
            onnxruntime,
            "InferenceSession",
            lambda path, options, **_: session(path, options, providers=[CPU]),
        )
        with pytest.raises(DeviceError, match="could not start it"):
            open_network(doubler(), OnnxOptions(provider="cuda"), "cuda")


class TestFiles:
    def test_a_missing_file_is_refused(self, tmp_path):
        with pytest.raises(BackendError, match=r"there is no file .*none.onnx"):
            open_network(tmp_path / "none.onnx", OnnxOptions(), "cpu")

    @pytest.mark.parametrize(
        "content",
        [b"", b"<html>404</html>", "cut short"],
    )
    def test_a_file_without_a_network_is_refused(self, doubler, content):
        path = doubler()
        path.write_bytes(path.read_bytes()[:-40] if content == "cut short" else content)
        with pytest.raises(BackendError, match=r"cannot open .*broken or cut short"):
            open_network(path, OnnxOptions(), "cpu")


CONFINED = """
import os, sys
from pathlib import Path
from physic_networks.onnx_sessions import open_session
cores = {min(os.sched_getaffinity(0))}
os.sched_setaffinity(0, cores)
before = set(os.listdir("/proc/self/task"))
kept = open_session(Path(sys.argv[1]), 0, "cpu", broken="")
tasks = set(os.listdir("/proc/self/task")) - before
assert all(os.sched_getaffinity(int(task)) == cores for task in tasks), "outside of the cores of the process"
assert kept.session.get_session_options().intra_op_num_threads == 1
"""  # noqa: E501


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs Linux")
def test_threads_0_stay_within_the_cores_of_the_process(doubler):
    done = subprocess.run(
        [sys.executable, "-c", CONFINED, str(doubler())], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
