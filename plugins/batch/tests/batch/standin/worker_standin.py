"""Worker processes that need no network, and do what the name of their task says."""

from __future__ import annotations

import errno
import os
import signal
import time
from functools import partial
from pathlib import Path

from physic_core.errors import ConfigError, NoPersonError, OutputError


def work(text, seconds=0.0):
    """Do what a text or the name of a file says."""
    name = Path(text).stem
    time.sleep(seconds)
    if name.startswith("meet"):  # end only when a second worker has come
        (Path(text).parent / f"{os.getpid()}.pid").touch()
        while len(list(Path(text).parent.glob("*.pid"))) < 2:
            time.sleep(0.02)
    if name.startswith("replaced"):
        Path(text).write_bytes(b"X" * Path(text).stat().st_size)
        time.sleep(600)
    if name.startswith("spin"):
        while True:
            pass
    if name.startswith("slow"):  # half a second of work in three by the clock
        for _ in range(10):
            time.sleep(0.25)
            end = time.process_time() + 0.05
            while time.process_time() < end:
                pass
    if name.startswith("hang"):
        time.sleep(600)
    if name.startswith("abort"):
        os.abort()
    if name.startswith("exit"):
        os._exit(7)
    if name.startswith("killed"):
        os.kill(os.getpid(), signal.SIGKILL)
    if name.startswith("once"):
        marker = Path(f"{text}.tried")
        if not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    if name.startswith("full"):
        raise OutputError("cannot write results: No space left on device") from OSError(
            errno.ENOSPC, ""
        )
    if name.startswith("nobody"):
        raise NoPersonError("no person was found")
    if name.startswith("broken"):
        raise ValueError("three\nlines\nhere")
    return f"{name} by {os.getpid()}"


def open_worker(seconds=0.0):
    return partial(work, seconds=seconds)


def refuse(*_):
    raise ConfigError("preset mock: 1 error")


def refuse_oddly():
    raise KeyError("weights")


def crash(*_):
    os.abort()
