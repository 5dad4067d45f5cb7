"""Workers and photos that need no network, for tests of the batch; worker processes import this
module.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

from physic_batch.process import BatchJob, PhotoProcessor
from physic_batch.run import run_batch, run_locally
from physic_batch.workers import WorkerSettings
from physic_core.configuration.model import load_config
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


class Result:
    """What the processor reads of a reconstruction; its numbers depend on the photo alone."""

    checks = ()
    people = ()
    distance_sigmas = ()
    grade = "good"
    photo = "sha256:0 pixels-sha256:1"

    def __init__(self, path):
        self._number = sum(Path(path).read_bytes()) / 7

    def summary(self):
        times = {"seconds": 0.5, "load_seconds": 0.0}
        return {"people": 1, **times, "focal_px": self._number, "scene_scale": None}


def reconstruct(path, settings, seconds):
    work(path, seconds)
    return Result(path)


def open_processor(job, seconds=0.0):
    return PhotoProcessor(job, partial(reconstruct, seconds=seconds))


def standin_job(out):
    return BatchJob(load_config(preset="mock"), str(out), "none", with_thumbnails=False)


def run_standin(
    folder,
    out,
    *,
    workers=2,
    seconds=0.0,
    timeout=None,
    **plan,
):
    """Run or resume a batch over the files of a folder, without networks."""
    from physic_batch.photos import list_photos
    from physic_batch.run import plan_batch

    job = standin_job(out)
    todo = plan_batch(list_photos([str(folder)]).photos, job, **plan).todo
    settings = WorkerSettings(workers, timeout, out / "logs")
    executor = partial(
        run_locally, settings=settings, open_worker=partial(open_processor, job, seconds)
    )
    run_batch(todo, job, executor, out / "journal.jsonl")


if __name__ == "__main__":
    run_standin(Path(sys.argv[1]), Path(sys.argv[2]), seconds=float(sys.argv[3]))
