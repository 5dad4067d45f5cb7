"""Limit the memory for reading a photo in a worker process."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_MAX_READING_BYTES = 2_000_000_000
"""More than any photo needs: files just below the limits of their formats took up to 1.27 GB."""


@contextmanager
def limited_memory(device: str) -> Iterator[None]:
    """Inside the block, limit a Linux worker with networks on a CPU to 2 GB more memory.

    Memory already in use does not count, since networks take from a few MB to many GB. CUDA reserves memory at any
    time, and is not limited.

    Args:
        device: of the networks.
    """
    if sys.platform != "linux" or device != "cpu" or multiprocessing.parent_process() is None:
        yield
        return
    import resource

    before = resource.getrlimit(resource.RLIMIT_DATA)
    held = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    limits = [limit for limit in (*before, held + _MAX_READING_BYTES) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min(limits), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
