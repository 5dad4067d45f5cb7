"""Stand-ins for published networks that answer what a test gives."""

from __future__ import annotations

import numpy as np
import pytest

from physic_onnx.sessions import Port


class StandInNetwork:
    """Stands for :class:`physic_onnx.sessions.Network`, and refuses what onnxruntime would refuse.

    Args:
        inputs: name -> shape.
        answer: output -> array, or a function that returns it of what is fed.

    Attributes:
        runs: how often it was run.
        fed: what it was fed last.
    """

    name = "stand_in.onnx"
    provider = "CPU"

    def __init__(self, inputs, answer):
        self._answer = answer if callable(answer) else lambda feed: answer
        self.inputs = {name: Port(name, "float32", shape) for name, shape in inputs.items()}
        self.runs = 0
        self.fed = {}

    def run(self, feed, outputs):
        assert set(feed) == set(self.inputs), f"fed {sorted(feed)}, wants {sorted(self.inputs)}"
        for name, value in feed.items():
            for side, stated in zip(value.shape, self.inputs[name].shape, strict=True):
                assert side == stated or isinstance(stated, str), name
        self.runs += 1
        self.fed = dict(feed)
        answers = self._answer(feed)
        return [np.asarray(answers[name], np.float32) for name in outputs]

    def answer(self, value):
        (name,) = self.inputs
        answers = self._answer({name: value})
        return self.run({name: value}, list(answers))


@pytest.fixture(scope="session")
def stand_in_network():
    return StandInNetwork


@pytest.fixture(scope="session")
def bound():
    """``bound(Adapter, network, **options)``: the adapter with a stand-in."""

    def bind(kind, network, **options):
        backend = kind(kind.Options(**options))
        backend._network = network
        return backend

    return bind
