"""Workers and photos that need no network; the actors of the tests import this module."""

from __future__ import annotations

import errno
import os
import time
from functools import partial
from pathlib import Path

from physic_batch.process import PhotoProcessor
from physic_core.errors import ConfigError, NoPersonError, OutputError


class Result:
    """What the processor reads of a reconstruction; its numbers depend on the photo alone."""

    checks = ()
    people = ()
    distance_sigmas = ()
    grade = "good"

    def __init__(self, path):
        content = Path(path).read_bytes()
        self.photo = f"sha256:{len(content)} pixels"
        self._number = sum(content) / 7

    def summary(self):
        return {
            "people": 1,
            "seconds": 0.5,
            "load_seconds": 0.0,
            "focal_px": self._number,
            "scene_scale": None,
        }


def reconstruct(path, settings, seconds):
    """Do what the name of the file says."""
    name = Path(path).stem
    time.sleep(seconds)
    if name.startswith("abort"):
        os.abort()
    if name.startswith("hang"):
        time.sleep(600)
    if name.startswith("full"):
        raise OutputError("cannot write results: No space left on device") from OSError(
            errno.ENOSPC, ""
        )
    if name.startswith("nobody"):
        raise NoPersonError("no person was found")
    if name.startswith("broken"):
        raise ValueError("two\nlines")
    return Result(path)


def open_worker(job, seconds=0.0):
    return PhotoProcessor(job, partial(reconstruct, seconds=seconds))


def refuse(job):
    raise ConfigError("preset mock: 1 error")


def crash(job):
    os.abort()
