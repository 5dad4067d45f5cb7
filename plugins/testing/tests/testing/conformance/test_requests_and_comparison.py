from __future__ import annotations

import platform
import socket

import numpy as np
import pytest

from physic_core.interfaces.comparison import describe_difference
from physic_core.types import DepthMap
from physic_testing.conformance.depths import aligned_depth_error
from physic_testing.conformance.network_and_memory import no_network, resident_megabytes

pytestmark = pytest.mark.quick

DEPTH = np.random.default_rng(0).uniform(1, 5, (20, 30))


def test_rounding_is_no_difference():
    assert describe_difference(DepthMap(DEPTH), DepthMap(DEPTH + 1e-5)) == ""
    assert describe_difference(DepthMap(DEPTH), DepthMap(1.01 * DEPTH)).startswith("depth: ")
    holes = DepthMap(np.where(DEPTH > 3, np.nan, DEPTH))
    assert describe_difference(holes, holes) == ""
    cut = describe_difference(DepthMap(DEPTH), DepthMap(DEPTH[:10]))
    assert cut == "depth: shapes (20, 30) and (10, 30)"
    sure = describe_difference(DepthMap(DEPTH, scale_sigma=0.1), DepthMap(DEPTH))
    assert sure == "scale_sigma: 0.1 and None"


def test_a_few_pixels_are_no_difference_but_more_are():
    mask = np.zeros((100, 100), bool)
    other = mask.copy()
    other[0, :5] = True
    assert describe_difference(mask, other) == ""
    other[:10] = True
    assert describe_difference(mask, other) == "image: 1000 of 10000 numbers differ"


def test_no_network_is_reached_by_name_or_by_number():
    with no_network() as asked, socket.socket() as line:
        with pytest.raises(
            OSError,
            match=r"^network access is blocked in this check: weights.example was requested$",
        ):
            socket.create_connection(("weights.example", 443))
        with pytest.raises(OSError, match=r"192\.0\.2\.1:80"):
            line.connect(("192.0.2.1", 80))
    assert asked == ["weights.example", "192.0.2.1:80"]
    assert socket.getaddrinfo("127.0.0.1", 80)


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc", reason="other allocators are not asked to return free memory"
)
def test_memory_that_the_allocator_had_kept_is_seen():
    mebibyte = 2**20 // 8
    # A larger block that was freed puts smaller ones onto the heap, which stays resident.
    np.ones(30 * mebibyte)
    blocks = [np.ones(20 * mebibyte) for _ in range(30)]
    above = bytes(100_000)
    del blocks
    before = resident_megabytes()
    block = np.ones(16_000_000)
    assert resident_megabytes() - before > 0.7 * block.nbytes / 1e6
    del above


@pytest.mark.parametrize(
    ("unknown", "relative"),
    [
        ("scale", DEPTH / 3),
        ("scale_shift", (DEPTH - 0.5) / 3),
        ("inverse_scale_shift", 3 / (1 / DEPTH + 0.2)),
    ],
)
def test_alignment_ignores_some_wrong_pixels(unknown, relative):
    spoilt = relative.copy()
    spoilt[:3] *= 1.7
    assert aligned_depth_error(spoilt, DEPTH, unknown) < 0.01
    if unknown != "scale":
        assert aligned_depth_error(relative, DEPTH, "scale") > 0.02
