"""Stand-ins for published networks: graphs of the same contract, and networks that answer what a
test gives.
"""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from physic_onnx.sessions import Port


def write_graph(
    path,
    inputs,
    outputs,
    nodes,
    constants=None,
    opset=14,
):
    """An ONNX file with these ports whose body is ``nodes`` of ``onnx.helper.make_node``, over
    named ``constants``.
    """

    def value_info(ports):
        return [
            helper.make_tensor_value_info(
                name, helper.np_dtype_to_tensor_dtype(np.dtype(dtype)), list(shape)
            )
            for name, (dtype, shape) in ports.items()
        ]

    held = [
        numpy_helper.from_array(np.asarray(value), name)
        for name, value in (constants or {}).items()
    ]
    graph = helper.make_graph(
        list(nodes), "contract", value_info(inputs), value_info(outputs), held
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.fixture(scope="session")
def graph():
    """:func:`write_graph`."""
    return write_graph


@pytest.fixture(scope="session")
def constant_graph():
    """``constant_graph(path, inputs, name=array, ...)``: an ONNX file that answers these arrays,
    whatever it is fed.
    """

    def write(path, inputs, **outputs):
        held = {f"held_{name}": np.asarray(value, np.float32) for name, value in outputs.items()}
        ports = {name: ("float32", np.shape(value)) for name, value in outputs.items()}
        nodes = [helper.make_node("Identity", [f"held_{name}"], [name]) for name in outputs]
        return write_graph(path, inputs, ports, nodes, held)

    return write


@pytest.fixture(scope="session")
def node():
    """``onnx.helper.make_node(kind, inputs, outputs, **attributes)``."""
    return helper.make_node


class StandInNetwork:
    """Stands for :class:`physic_onnx.sessions.Network`, and refuses what onnxruntime would refuse.

    Args:
        inputs: ports, as for :func:`write_graph`.
        answer: output -> array, or a function that returns it of what is fed.
        outputs: ports; by default float32 of the shapes of the answer.
        shares_ranges: as of the network.

    Attributes:
        runs: how often it was run.
        fed: what it was fed last.
    """

    name = "stand_in.onnx"
    provider = "CPU"

    def __init__(self, inputs, answer, outputs=None, *, shares_ranges=False):
        self.answer = answer if callable(answer) else lambda feed: answer
        stated = outputs or {name: ("float32", np.shape(value)) for name, value in answer.items()}
        self.inputs, self.outputs = (
            {name: Port(name, dtype, tuple(shape)) for name, (dtype, shape) in ports.items()}
            for ports in (inputs, stated)
        )
        self.shares_ranges = shares_ranges
        self.runs = 0
        self.fed = {}

    def run(self, feed, outputs):
        assert set(feed) == set(self.inputs), f"fed {sorted(feed)}, wants {sorted(self.inputs)}"
        for name, value in feed.items():
            port = self.inputs[name]
            assert value.dtype.kind == np.dtype(port.dtype).kind, name
            for side, stated in zip(value.shape, port.shape, strict=True):
                assert side == stated or isinstance(stated, str), name
        self.runs += 1
        self.fed = dict(feed)
        answers = self.answer(feed)
        return [np.asarray(answers[name], self.outputs[name].dtype) for name in outputs]


@pytest.fixture(scope="session")
def stand_in_network():
    return StandInNetwork


@pytest.fixture(scope="session")
def bound():
    """``bound(Adapter, network, **options)``: the adapter with a stand-in."""

    def bind(kind, network, **options):
        backend = kind(kind.Options(**options))
        backend._network = backend.match(network)
        return backend

    return bind


@pytest.fixture(scope="session")
def loaded():
    """``loaded(Adapter, path, **options)``: the adapter with this file."""

    def load(kind, path, **options):
        backend = kind(kind.Options(weights=str(path), **options))
        backend.load()
        return backend

    return load
