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
from physic_onnx.sessions import OnnxOptions, Port, open_network

CPU = "CPUExecutionProvider"
CUDA = "CUDAExecutionProvider"
TENSORRT = "TensorrtExecutionProvider"
COREML = "CoreMLExecutionProvider"
DIRECTML = "DmlExecutionProvider"


@pytest.fixture
def doubler(graph, node, tmp_path):
    """A graph that answers twice its image, plus a number of another type."""

    def build(dtype="float32", name="double.onnx"):
        nodes = [
            node(
                "Cast",
                ["count"],
                ["number"],
                to=onnx.helper.np_dtype_to_tensor_dtype(np.dtype(dtype)),
            ),
            node("Add", ["image", "image"], ["twice"]),
            node("Add", ["twice", "number"], ["sum"]),
        ]
        inputs = {"image": (dtype, ("batch", 3, "height", "width")), "count": ("int64", ())}
        return graph(
            tmp_path / name, inputs, {"sum": (dtype, ("batch", 3, "height", "width"))}, nodes
        )

    return build


ONE = {"image": np.ones((1, 3, 2, 2)), "count": np.array(1)}


class TestRunning:
    def test_a_border_of_zeros_before_a_max_pool_stays_zero(self, graph, node, tmp_path):
        nodes = [
            node("Pad", ["map", "border"], ["padded"]),
            node("MaxPool", ["padded"], ["peaks"], kernel_shape=[3, 3]),
        ]
        ports = ("float32", (1, 1, 4, 4))
        border = {"border": np.array([0, 0, 1, 1, 0, 0, 1, 1])}
        path = graph(tmp_path / "peaks.onnx", {"map": ports}, {"peaks": ports}, nodes, border)
        (peaks,) = open_network(path, OnnxOptions(), "cpu").run(
            {"map": np.full((1, 1, 4, 4), -1.0)}, ["peaks"]
        )
        assert peaks[0, 0].tolist() == [[0, 0, 0, 0], [0, -1, -1, 0], [0, -1, -1, 0], [0, 0, 0, 0]]

    def test_a_file_with_dynamic_ranges_shares_them_among_its_rows(self, graph, node, tmp_path):
        outputs = {"y": ("uint8", (2,)), "scale": ("float32", ()), "zero": ("uint8", ())}
        nodes = [node("DynamicQuantizeLinear", ["x"], list(outputs))]
        path = graph(tmp_path / "bytes.onnx", {"x": ("float32", (2,))}, outputs, nodes)
        assert open_network(path, OnnxOptions(), "cpu").shares_ranges

    def test_ports_tell_names_types_and_shapes(self, doubler):
        network = open_network(doubler(), OnnxOptions(), "cpu")
        assert network.name == "double.onnx"
        assert network.provider == "CPU"
        assert not network.shares_ranges
        assert dict(network.inputs) == {
            "image": Port("image", "float32", ("batch", 3, "height", "width")),
            "count": Port("count", "int64", ()),
        }
        assert dict(network.outputs) == {
            "sum": Port("sum", "float32", ("batch", 3, "height", "width"))
        }

    @pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
    @pytest.mark.parametrize("fed", [np.float16, np.float32, np.float64])
    def test_floats_are_cast_to_what_the_file_takes(self, doubler, dtype, fed):
        network = open_network(doubler(dtype), OnnxOptions(), "cpu")
        image = np.full((1, 3, 4, 5), 0.25, fed)
        (answer,) = network.run({"image": image, "count": np.array(2, np.int32)}, ["sum"])
        assert answer.dtype == ("float64" if dtype == "float64" else "float32")
        np.testing.assert_array_equal(answer, 2.5)

    def test_bytes_are_not_taken_for_floats(self, doubler):
        network = open_network(doubler(), OnnxOptions(), "cpu")
        with pytest.raises(BackendError, match="takes float32, got uint8"):
            network.run({**ONE, "image": np.ones((1, 3, 2, 2), np.uint8)}, ["sum"])

    def test_a_failed_run_names_shape_and_dtype_of_the_input(self, doubler):
        network = open_network(doubler(), OnnxOptions(), "cpu")
        with pytest.raises(BackendError, match=r"image float32 \(1, 2, 2\)"):
            network.run({**ONE, "image": np.ones((1, 2, 2), np.float32)}, ["sum"])

    @pytest.mark.parametrize("dtype", ["float16", "float32"])
    def test_an_output_of_nan_is_a_failed_network(self, doubler, dtype):
        """NaN in a part of an output is left to the backend."""
        network = open_network(doubler(dtype), OnnxOptions(), "cpu")
        image = np.full((1, 3, 2, 2), np.nan)
        with pytest.raises(BackendError, match=r"output 'sum'.*without one finite number"):
            network.run({**ONE, "image": image}, ["sum"])
        image[0, 0, 0, 0] = 1
        (found,) = network.run({**ONE, "image": image}, ["sum"])
        assert np.isfinite(found).sum() == 1


class TestProviders:
    @pytest.mark.parametrize(
        ("name", "device", "available", "asked"),
        [
            ("auto", "cpu", [CPU], [CPU]),
            ("auto", "cpu", [TENSORRT, CUDA, CPU], [CPU]),
            ("auto", "cuda", [TENSORRT, CUDA, CPU], [(CUDA, "0")]),
            ("auto", "cuda:1", [CUDA, CPU], [(CUDA, "1")]),
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
                "tensorrt",
                "cuda",
                "is TensorRT, .* install onnxruntime-gpu .* and TensorRT beside it",
            ),
            ("coreml", "cpu", "is CoreML, .* use the onnxruntime for macOS"),
            (
                "directml",
                "cpu",
                "is DirectML, .* install onnxruntime-directml .*, or choose provider 'cpu'",
            ),
            ("auto", "mps", "unknown device 'mps': use 'cpu', 'cuda' or 'cuda:N'"),
            ("auto", "cpu:1", "unknown device 'cpu:1'"),
        ],
    )
    def test_a_missing_provider_is_refused_with_the_package_to_install(self, name, device, words):
        with pytest.raises(DeviceError, match=words):
            select_provider(name, device, ["AzureExecutionProvider", CPU])

    @pytest.mark.parametrize("provider", ["cuda", "tensorrt"])
    def test_a_provider_that_does_not_start_is_an_error_and_not_the_cpu(
        self, doubler, monkeypatch, provider
    ):
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
            open_network(doubler(), OnnxOptions(provider=provider), "cuda")


class TestFiles:
    def test_a_missing_file_is_refused(self, tmp_path):
        with pytest.raises(BackendError, match=r"there is no file .*none.onnx"):
            open_network(tmp_path / "none.onnx", OnnxOptions(), "cpu")

    @pytest.mark.parametrize(
        "content",
        [b"", b"<html>404</html>", b"version https://git-lfs.github.com/spec/v1\n", "cut short"],
    )
    def test_a_file_without_a_network_is_refused(self, doubler, content):
        path = doubler()
        path.write_bytes(path.read_bytes()[:-40] if content == "cut short" else content)
        with pytest.raises(BackendError, match=r"cannot open .*broken or cut short"):
            open_network(path, OnnxOptions(), "cpu")

    @pytest.mark.parametrize("location", ["model.onnx_data", "parts/weights.bin"])
    def test_weights_in_other_files_are_named_where_they_lack(
        self, graph, node, tmp_path, location
    ):
        path = graph(
            tmp_path / "model.onnx",
            {"x": ("float32", (4,))},
            {"y": ("float32", (4,))},
            [node("Add", ["x", "w"], ["y"])],
            {"w": np.arange(4, dtype=np.float32)},
        )
        model = onnx.load(path)
        (tmp_path / location).parent.mkdir(exist_ok=True)
        onnx.external_data_helper.convert_model_to_external_data(
            model, location=location, size_threshold=0
        )
        onnx.save(model, path)
        (answer,) = open_network(path, OnnxOptions(), "cpu").run({"x": np.zeros(4)}, ["y"])
        np.testing.assert_array_equal(answer, [0, 1, 2, 3])
        (tmp_path / location).unlink()
        with pytest.raises(BackendError, match=(tmp_path / location).name):
            open_network(path, OnnxOptions(), "cpu")


CONFINED = """
import os, sys
from pathlib import Path
from physic_networks.onnx_sessions import open_session
cores = {min(os.sched_getaffinity(0))}
os.sched_setaffinity(0, cores)
before = set(os.listdir("/proc/self/task"))
kept = open_session(Path(sys.argv[1]), 0, "cpu", broken="")
own = set(os.listdir("/proc/self/task")) - before
assert all(os.sched_getaffinity(int(task)) == cores for task in own), "outside of the cores of the process"
assert kept.session.get_session_options().intra_op_num_threads == 1
"""  # noqa: E501


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs Linux")
def test_threads_0_stay_within_the_cores_of_the_process(doubler):
    done = subprocess.run(
        [sys.executable, "-c", CONFINED, str(doubler())], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
