"""Run a program, and measure what it costs."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class ProcessCost:
    """Exit code, processor seconds of all threads, and peak memory in GB (of Linux)."""

    code: int
    cpu_s: float
    memory_gb: float


def run_measured(
    command: Sequence[str],
    *,
    env: Mapping[str, str] | None = None,
    cwd: Path | None = None,
    output: Any = subprocess.DEVNULL,
    check: bool = True,
) -> ProcessCost:
    """Run a command to its end, its output to a file or nowhere.

    Raises:
        SystemExit: it failed, and ``check``.
    """
    process = subprocess.Popen(command, env=env, cwd=cwd, stdout=output, stderr=output)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if check and process.returncode:
        raise SystemExit(f"`{' '.join(command)}` ended with {process.returncode}")
    return ProcessCost(process.returncode, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 2**20)
