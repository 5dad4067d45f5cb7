"""Cores and memory that this process may use."""

from __future__ import annotations

import math
import os
import sys
from contextlib import suppress
from pathlib import Path

_MEMORY_RESERVE = 1.25
"""A worker is expected to need this multiple of what its first photo needed."""


def usable_cores() -> int:
    """Return the number of cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def default_workers(peak_mb: float, device: str = "cpu") -> int:
    """Return how many workers fit: one per core, as memory allows; one if they share a GPU.

    Args:
        peak_mb: memory of the first worker after its first photo, MB; 0 if unknown, then one worker is used.
        device: of the networks.
    """
    if device != "cpu" or peak_mb <= 0:
        return 1
    free_mb = [math.inf]  # of the machine, and of the container
    with suppress(OSError, ValueError):
        text = Path("/proc/meminfo").read_text()
        free_mb.append(float(text.partition("MemAvailable:")[2].split()[0]) / 1000)
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        used = float((group / "memory.current").read_text())
        free_mb.append((float((group / "memory.max").read_text()) - used) / 1e6)
    more = max(0.0, min(free_mb)) / (_MEMORY_RESERVE * peak_mb)
    return max(1, int(min(usable_cores(), 1 + more)))


def peak_memory_mb() -> float:
    """Return the peak resident memory of this process, MB; 0 if it is unknown."""
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)
