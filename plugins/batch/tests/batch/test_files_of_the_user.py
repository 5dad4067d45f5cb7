"""A batch replaces no file that it has not written, opens none through a link, and says so before
the first photo.
"""

from __future__ import annotations

import os
import shutil

import pytest
from click.testing import CliRunner

from physic_batch.contact_sheet import write_thumbnail
from physic_batch.journal import read_journals
from physic_batch.photos import list_photos, photo_folder
from physic_batch.process import BatchJob, PhotoProcessor
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


def painted(path):
    path.write_text("mine")


def replaced_by_a_link(path):
    path.unlink()
    path.symlink_to(path.with_name("mine"))


@pytest.mark.parametrize(
    ("name", "change"), [("preview.png", painted), ("combined.glb", replaced_by_a_link)]
)
@pytest.mark.parametrize(
    "why", ["nothing changed", "another setting", "deleted arrays", "deleted document"]
)
def test_an_edited_file_of_a_result_is_kept(
    name,
    why,
    change,
    photos,
    tmp_path,
    monkeypatch,
):
    """A batch does not do a photo again for it, and keeps it beside the new one where it does for
    another reason.
    """
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

    def run(job):
        todo = plan_batch([item], job).todo
        process = PhotoProcessor(job, lambda path, settings: tiny_result())
        run_batch(
            todo, job, lambda items, job: (process(one) for one in items), out / "journal.jsonl"
        )
        assert [row["state"] for row in read_journals(out).values()] == ["done"]
        return len(todo)

    assert run(jobs[0]) == 1
    folder = out / photo_folder(item.id)
    (folder / "mine").write_text("mine")
    change(folder / name)
    if why.startswith("deleted"):
        (folder / f"reconstruction.{'npz' if why == 'deleted arrays' else 'json'}").unlink()
    assert run(jobs[why == "another setting"]) == (why != "nothing changed")
    kept = folder / (name if why == "nothing changed" else name.replace(".", ".edited."))
    assert (kept.read_text(), kept.is_symlink()) == ("mine", change is replaced_by_a_link)
    load_reconstruction(folder)


def test_a_thumbnail_of_the_user_stays(tmp_path):
    for _ in range(2):
        write_thumbnail(tiny_result(), tmp_path, "photos/3f/a")
    thumbnail = tmp_path / "thumbnails" / "3f" / "a.jpg"
    thumbnail.write_text("mine")
    with pytest.raises(OutputError):
        write_thumbnail(tiny_result(), tmp_path, "photos/3f/a")
    assert thumbnail.read_text() == "mine"
