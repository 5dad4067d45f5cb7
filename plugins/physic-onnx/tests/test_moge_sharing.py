"""MoGe-2 serves two interfaces and looks at each photo once."""

from __future__ import annotations

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import Hints
from physic_onnx.moge import Moge2Depth, Moge2Pointmap, MogeOptions

HEIGHT = 48
WIDTH = 64
INPUTS = {"image": ("float32", ("b", 3, "h", "w")), "num_tokens": ("int64", ())}
OUTPUTS = {
    "points": ("float32", ("b", "h", "w", 3)),
    "mask": ("float32", ("b", "h", "w")),
    "scale": ("float32", ("b",)),
}


def slope(feed):
    """A tilted plane, whatever is shown."""
    height, width = feed["image"].shape[2:]
    v, u = np.mgrid[:height, :width]
    z = 2.0 + u / width
    points = np.stack([(u - (width - 1) / 2) / 60 * z, (v - (height - 1) / 2) / 60 * z, z], -1)
    return {"points": points[None], "mask": np.ones((1, height, width)), "scale": [1.5]}


@pytest.fixture
def network(stand_in_network):
    return stand_in_network(INPUTS, OUTPUTS, slope)


@pytest.fixture
def opened(network):
    """How often the file was opened."""
    count = []

    def opener():
        count.append(1)
        return network

    opener.count = count
    return opener


@pytest.fixture
def photos():
    return np.random.default_rng(3).integers(0, 255, (3, HEIGHT, WIDTH, 3), np.uint8)


def open_in(backend, identity, opener):
    """Load a backend as from a file."""
    backend.runner.members.add(backend)
    backend._network = backend.runner.open(identity, opener)


def backends(opener=None):
    """One of each interface, with settings that no other test has, and opened if it is given."""
    both = [kind(MogeOptions(threads=7)) for kind in (Moge2Pointmap, Moge2Depth)]
    for backend in both:
        if opener is not None:
            open_in(backend, "file", opener)
    return both


def test_both_interfaces_run_the_network_once_a_photo(network, opened, photos):
    pointmap, depth = backends(opened)
    inpainted, original, _ = photos
    scene = pointmap.infer(inpainted, Hints())
    pointmap.infer(original, Hints(intrinsics=scene.intrinsics))
    found = depth.infer(inpainted.copy(), Hints(intrinsics=scene.intrinsics))
    assert network.runs == 2
    assert len(opened.count) == 1
    np.testing.assert_allclose(found.depth, 1.5 * scene.points[..., 2], rtol=1e-6)


def test_pointmap_closed_before_the_depth_is_loaded_leaves_it_the_answers(network, opened, photos):
    """As the pipeline does where memory is low."""
    pointmap, depth = backends()
    open_in(pointmap, "file", opened)
    pointmap.infer(photos[0], Hints())
    pointmap.close()
    open_in(depth, "file", opened)
    depth.infer(photos[0], Hints())
    assert network.runs == 1
    assert len(opened.count) == 2


def test_last_one_to_close_drops_the_network_and_the_answers(network, opened, photos):
    pointmap, depth = backends(opened)
    depth.infer(photos[0], Hints())
    pointmap.close()
    depth.infer(photos[1], Hints())
    depth.close()
    with pytest.raises(BackendError, match="not loaded"):
        depth.infer(photos[0], Hints())
    open_in(depth, "file", opened)
    depth.infer(photos[0], Hints())
    assert network.runs == 3
    assert len(opened.count) == 2
    depth.close()
    depth.close()


def test_threads_that_ask_the_same_wait_for_one_run(network, opened, photos):
    members = [backend for _ in range(3) for backend in backends(opened)]
    with ThreadPoolExecutor(len(members)) as pool:
        list(pool.map(lambda backend: backend.infer(photos[0], Hints()), members))
    assert network.runs == 1


def test_nothing_is_left_when_the_backends_are_gone(opened, photos):
    pointmap, depth = backends()
    runner = weakref.ref(depth.runner)
    open_in(depth, "file", opened)
    depth.infer(photos[0], Hints())
    del pointmap, depth
    gc.collect()
    assert runner() is None
