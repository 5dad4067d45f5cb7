"""A batch replaces no file that it has not written, opens none through a link, and says so before
the first photo.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from physic_batch.contact_sheet import write_thumbnail
from physic_batch.journal import read_journals
from physic_batch.parquet import write_parquet
from physic_batch.photo_processor import BatchJob, PhotoProcessor
from physic_batch.photos import list_photos, photo_folder
from physic_batch.run import plan_batch, run_batch
from physic_core import load_reconstruction
from physic_core.cli import main
from physic_core.cli.exit_codes import USAGE
from physic_core.configuration.model import load_config
from physic_core.errors import OutputError
from tests.rooms import tiny_result

NAMES = (
    *("summary.csv", "people.csv", "people.parquet"),
    *("contact-sheet.html", "journal.jsonl", "logs/worker-0.txt"),
)
MINE = '{"id": "mine", "stature": 1.71}\n'


def batch(photos, out, *options):
    arguments = ("batch", photos, "-o", str(out), "--preset", "mock", "--workers", "1", *options)
    return CliRunner().invoke(main, arguments)


@pytest.fixture
def photos(tmp_path):
    """A folder with a file that no worker can read."""
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "broken.jpg").write_text("no photo")
    return tmp_path / "photos"


@pytest.mark.parametrize("place", [shutil.copy, os.symlink], ids=["copied", "linked"])
@pytest.mark.parametrize("name", NAMES)
def test_a_file_of_the_user_ends_the_batch_before_its_first_photo(name, place, photos, tmp_path):
    path = tmp_path / "out" / name
    victim = tmp_path / "victim"
    path.parent.mkdir(parents=True)
    victim.write_text(MINE)
    place(victim, path)
    done = batch(str(photos), tmp_path / "out")
    assert (done.exit_code, f"cannot write {path}" in done.stderr) == (USAGE, True)
    assert path.read_text() == victim.read_text() == MINE
    assert "[1/1]" not in done.stderr


def make_pipe(path):
    os.mkfifo(path)


def make_device(path):
    path.symlink_to("/dev/zero")


SPECIAL = (Path.mkdir, make_pipe, make_device)


@pytest.mark.parametrize("make", SPECIAL, ids=lambda make: make.__name__)
@pytest.mark.parametrize("name", [*NAMES, "summary.parquet", "journal.lock"])
def test_what_is_no_regular_file_ends_the_batch_with_its_name(name, make, photos, tmp_path):
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True)
    make(path)
    done = batch(str(photos), tmp_path / "out")
    assert (done.exit_code, f"cannot write {path}" in done.stderr) == (USAGE, True)


IDS = ["NA", "nan", "null", "", "=1", "+1", "-1", "@a", "'a", "1", "True", "a,b", 'a"b', "a\nb"]


def test_parquet_keeps_each_text(tmp_path):
    rows = [{"id": one, "state": one, "n": None, "s": "NaN"} for one in IDS]
    write_parquet(tmp_path / "a", ["id", "state", "n", "s"], rows, {"id"})
    table = pq.read_table(tmp_path / "a")
    for name in ("id", "state"):
        assert table[name].to_pylist() == [one or None for one in IDS]
    assert table["s"].to_pylist() == ["NaN"] * len(IDS)


@pytest.mark.parametrize("why", ["nothing changed", "another setting", "deleted arrays"])
def test_a_photo_whose_result_was_edited_fails_before_it_is_computed(
    why, photos, tmp_path, monkeypatch
):
    monkeypatch.setattr("physic_visual.pictures.combined_glb", lambda result: b"mesh")
    monkeypatch.setattr("physic_visual.pictures.preview_png", lambda result: b"picture")
    out = tmp_path / "out"
    (item,) = list_photos([str(photos)]).photos
    jobs = [
        BatchJob(
            load_config(preset="mock", overrides=[f"photo.max_side={side}"]), str(out), "pictures"
        )
        for side in (640, 320)
    ]
    calls = []

    def reconstruct(path, settings):
        calls.append(path)
        return tiny_result()

    def run(job):
        todo = plan_batch([item], job).todo
        process = PhotoProcessor(job, reconstruct)
        run_batch(
            todo, job, lambda items, job: (process(one) for one in items), out / "journal.jsonl"
        )
        (row,) = read_journals(out).values()
        return row["message"]

    assert run(jobs[0]) == ""
    folder = out / photo_folder(item.id)
    (folder / "preview.png").write_text("mine")
    if why == "deleted arrays":
        (folder / "reconstruction.npz").unlink()
    job = jobs[why == "another setting"]
    message = run(job)
    assert ("preview.png there was not written by a run" in message) == (why != "nothing changed")
    assert ((folder / "preview.png").read_text(), len(calls)) == ("mine", 1)
    folder.rename(tmp_path / "mine")
    assert run(job) == ""
    load_reconstruction(folder)


def test_a_thumbnail_of_the_user_stays(tmp_path):
    for _ in range(2):
        write_thumbnail(tiny_result(), tmp_path, "photos/3f/a")
    thumbnail = tmp_path / "thumbnails" / "3f" / "a.jpg"
    thumbnail.write_text("mine")
    with pytest.raises(OutputError):
        write_thumbnail(tiny_result(), tmp_path, "photos/3f/a")
    assert thumbnail.read_text() == "mine"
