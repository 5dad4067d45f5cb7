"""A batch whose photos need no network; worker processes import this module."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

from worker_standin import work

from physic_batch.photo_processor import BatchJob, PhotoProcessor
from physic_batch.run import run_batch, run_locally
from physic_batch.workers import WorkerSettings
from physic_core.configuration.model import load_config


class Result:
    """What the processor reads of a reconstruction; its numbers depend on the photo alone."""

    checks = ()
    people = ()
    distance_sigmas = ()
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
