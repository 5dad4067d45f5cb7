"""Outputs of networks in the cache: taken from it for equal inputs of the same network, and
computed otherwise.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.cache.digests import Digester
from physic_core.cache.results import ResultCache, cached_network_result, network_results_in

pytestmark = pytest.mark.quick

IMAGE = np.arange(12, dtype=np.float32).reshape(1, 3, 2, 2)
OUTPUTS = (np.array([[1.5, np.nan]], np.float32), np.zeros((0, 4), np.int64))


class Network:
    """A network that counts its runs."""

    runs = 0

    def __call__(self):
        self.runs += 1
        return OUTPUTS

    def outputs(self, image=IMAGE, made_of="sha256 CPU"):
        return cached_network_result("depth", made_of, {"image": image}, self)


@pytest.fixture
def network():
    return Network()


@pytest.fixture
def cache(tmp_path):
    return ResultCache(tmp_path / "results", 10**6)


def test_equal_inputs_are_not_run_again(cache, network):
    with network_results_in(cache):
        first = network.outputs()
        second = network.outputs(IMAGE.copy())
    assert network.runs == 1
    assert Digester().digest(first) == Digester().digest(second) == Digester().digest(OUTPUTS)


@pytest.mark.parametrize(
    "other",
    [
        {"image": np.nextafter(IMAGE, np.float32(99))},
        {"image": IMAGE.reshape(1, 3, 1, 4)},
        {"made_of": "sha256 CUDA"},
    ],
    ids=["value", "shape", "network"],
)
def test_another_input_or_network_is_run(cache, network, other):
    with network_results_in(cache):
        network.outputs()
        network.outputs(**other)
    assert network.runs == 2


def test_nothing_is_kept_outside_of_a_run_with_a_cache(cache, network):
    with network_results_in(cache):
        with network_results_in(None):
            network.outputs()
        network.outputs()
    network.outputs()
    assert network.runs == 3
