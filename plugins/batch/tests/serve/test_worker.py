"""The worker process: what a photo that breaks it costs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from time import sleep
from zipfile import ZipFile

import pytest

from physic_core import BackendError
from physic_serve.jobs import Jobs
from physic_serve.worker import Worker

from .conftest import PHOTO, Served

STAND_IN = """
import os, pathlib, signal, time
from physic_core import BackendError, InputError

class Folders:
    def save(self, folder):
        pass

    def report(self, path, title):
        pass

    def summary(self):
        return {}

    def export(self, folder, name):
        path = pathlib.Path(folder, *(["images"] if name == "colmap" else []), f"of-{name}.bin")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"content")


def open_pipeline(config):
    if config == "refuse":
        raise BackendError("no weights")
    if config == "slow from the second on":
        if pathlib.Path("opened").exists():
            pathlib.Path("opened again").touch()
            time.sleep(60)
            pathlib.Path("loaded again").touch()
        pathlib.Path("opened").touch()

    def reconstruct(task, progress):
        progress("people", 0, 1)
        if task.photo == b"kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if task.photo == b"exit":
            os._exit(7)
        if task.photo == b"hang":
            time.sleep(600)
        if task.photo == b"folders":
            return Folders()
        raise InputError("the photo is broken")

    return reconstruct
"""


@pytest.fixture
def open_worker(tmp_path, monkeypatch):
    """A worker whose process runs the stand-in; a spawned process has the import path of its
    parent.
    """
    (tmp_path / "stand_in_of_pipeline.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(tmp_path)
    import stand_in_of_pipeline

    return partial(Worker, exports=("colmap", "bvh"), open_=stand_in_of_pipeline.open_pipeline)


@pytest.fixture
def jobs(tmp_path, open_worker):
    (tmp_path / "results").mkdir()
    found = Jobs(tmp_path / "results", partial(open_worker, ""))
    yield found
    found.close()


def ended(job):
    while not job.finished:
        sleep(0.02)
    return job.error


def test_a_photo_that_breaks_the_process_costs_itself_alone(jobs):
    added = [jobs.add(word, "a photo", {}) for word in (b"kill", b"bad", b"exit", b"bad")]
    killed, bad, left, last = (ended(job) for job in added)
    assert "code -9" in killed
    assert "code 7" in left
    assert bad == last == "the photo is broken"
    assert [job.stages for job in added] == [[("people", 0, 1)]] * 4


def test_an_export_with_folders_is_one_archive(jobs):
    job = jobs.add(b"folders", "a photo", {})
    assert ended(job) == ""
    assert list(job.files) == ["colmap.zip", "of-bvh.bin"]
    with ZipFile(job.files["colmap.zip"]) as archive:
        assert archive.read("images/of-colmap.bin") == b"content"


def test_a_photo_that_hangs_can_be_stopped(jobs):
    hanging, next_one = (jobs.add(word, "a photo", {}) for word in (b"hang", b"bad"))
    while not hanging.stages:
        sleep(0.02)
    jobs.stop(hanging)
    assert ended(hanging) == "it was stopped"
    assert ended(next_one) == "the photo is broken"


def test_models_that_cannot_be_loaded_are_an_error(open_worker, tmp_path):
    with pytest.raises(BackendError, match="no weights"):
        Jobs(tmp_path, partial(open_worker, "refuse"))


@pytest.mark.parametrize("how", ["stop", "close"])
def test_a_process_that_loads_again_is_not_waited_for(how, open_worker, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results").mkdir()
    jobs = Jobs(tmp_path / "results", partial(open_worker, "slow from the second on"))
    ended(jobs.add(b"kill", "a photo", {}))
    waits = jobs.add(b"bad", "a photo", {})
    while not Path("opened again").exists():
        sleep(0.02)
    if how == "stop":
        jobs.stop(waits)
    jobs.close()
    assert waits.error == "it was stopped"
    assert not Path("loaded again").exists()


def test_a_server_that_ends_opens_no_other_worker_for_photos_that_wait(tmp_path):
    served = Served(tmp_path)
    jobs = [served.jobs.add(PHOTO, "a photo", {}) for _ in range(200)]
    while jobs[0].state != "running":
        sleep(0.02)
    served.jobs.close()
    assert {job.error for job in jobs} == {"it was stopped"}
    assert len(served.workers) == 1
    assert not [path for path in tmp_path.iterdir() if path.is_file()]
