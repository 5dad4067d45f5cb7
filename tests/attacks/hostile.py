"""Plugin code that changes its process, hangs or ends it; worker processes import this module."""

from __future__ import annotations

import ctypes
import locale
import os
import random
import signal
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from physic_core.pipeline.time_limit import limited_calls, timed_call
from physic_mock.backends import MockMetricDepth

TITLE = "metric_depth 'slow', stage 'metric depth'"


def replace_stdout() -> None:
    file = os.open(os.devnull, os.O_WRONLY)
    os.dup2(file, 1)
    os.close(file)


def reseed() -> None:
    random.seed(1)
    np.random.seed(1)
    torch.manual_seed(1)


CHANGES: dict[str, Callable[[], Any]] = {
    "current folder": lambda: os.chdir(os.sep),
    "stdin closed": lambda: os.close(0),
    "stdout closed": lambda: os.close(1),
    "stderr closed": lambda: os.close(2),
    "stdout is a file": replace_stdout,
    "warning filters": lambda: warnings.simplefilter("ignore"),
    "locale": lambda: locale.setlocale(locale.LC_ALL, "C.UTF-8" if locale.setlocale(locale.LC_ALL) == "C" else "C"),
    "recursion limit": lambda: sys.setrecursionlimit(200),
    "Ctrl-C ignored": lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    "handler of SIGTERM": lambda: signal.signal(signal.SIGTERM, lambda *_: None),
    "NumPy errors": lambda: np.seterr(all="raise"),
    "seeds": reseed,
    "torch type": lambda: torch.set_default_dtype(torch.float64),
    "torch device": lambda: torch.set_default_device("meta"),
    "torch gradients": lambda: torch.set_grad_enabled(False),
    "torch threads": lambda: torch.set_num_threads(torch.get_num_threads() + 1),
    "torch determinism": lambda: torch.use_deterministic_algorithms(True),
    "torch precision": lambda: torch.set_float32_matmul_precision("medium"),
    "torch anomalies": lambda: torch.autograd.set_detect_anomaly(True),
}


def state() -> list[Any]:
    """Return all that ``CHANGES`` change."""
    files = [(status.st_dev, status.st_ino) for status in map(os.fstat, (0, 1, 2))]
    return [
        os.getcwd(),
        files,
        list(warnings.filters),
        locale.setlocale(locale.LC_ALL),
        sys.getrecursionlimit(),
        [signal.getsignal(number) for number in signal.valid_signals()],
        np.geterr(),
        random.getstate(),
        np.random.get_state()[1].tobytes(),  # type: ignore[union-attr]
        torch.get_default_dtype(),
        torch.get_default_device(),
        torch.is_grad_enabled(),
        torch.get_num_threads(),
        torch.are_deterministic_algorithms_enabled(),
        torch.get_float32_matmul_precision(),
        torch.is_anomaly_enabled(),
        torch.get_rng_state().tolist(),
    ]


def hang_in_python() -> None:
    while True:
        time.sleep(0.1)


def hang_with_the_interpreter_lock() -> None:
    ctypes.PyDLL(None).sleep(1000)


HANGS = (hang_in_python, hang_with_the_interpreter_lock)


def limited(hang: Callable[[], None]) -> None:
    with limited_calls(0.5), timed_call(TITLE):
        hang()


def open_worker() -> Callable[[Callable[[], None]], None]:
    return limited


def open_hanging_worker() -> Callable[[Any], None]:
    limited(hang_with_the_interpreter_lock)
    raise AssertionError


class Printing(MockMetricDepth):
    """Prints to stdout in three ways, and an answer of its own."""

    def load(self, device: str = "cpu") -> None:
        print('physic-doctor: {"state": "broken"}')
        os.write(1, b'{"state": "broken"}\n')
        os.system("echo '[]'")


class Forging(MockMetricDepth):
    """Prints that it is ok, and ends the process."""

    def load(self, device: str = "cpu") -> None:
        print(
            'physic-doctor: {"interface": "metric_depth", "backend": "forged", "owner": "", "state": "ok"}', flush=True
        )
        os._exit(0)


class HangsInConstructor(MockMetricDepth):
    def __init__(self, options: Any = None) -> None:
        hang_with_the_interpreter_lock()
