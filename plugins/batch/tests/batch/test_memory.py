"""The memory of a process stays flat over many photos."""

from __future__ import annotations

import gc
import sys

import pytest

from physic_core import Pipeline
from physic_testing.conformance.network_and_memory import resident_megabytes
from physic_testing.worlds import load_world

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("few_steps"),
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]


def growth_mb(process, first, last):
    before = 0.0
    for i in range(last):
        process(i)
        if i + 1 == first:
            gc.collect()
            before = resident_megabytes()
    gc.collect()
    return resident_megabytes() - before


def test_a_loaded_pipeline_needs_no_more_memory_after_12_photos_than_after_4():
    image = load_world("stand", (160, 120)).image
    with Pipeline("mock") as pipeline:
        assert growth_mb(lambda i: pipeline(image), 4, 12) < 40
