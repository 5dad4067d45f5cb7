"""The command ``physic batch``: from a folder to a table and a page, and what ends it before the
first photo.
"""

from __future__ import annotations

import csv
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from physic_batch.photo_processor import failed_row
from physic_testing.worlds import load_world

pytestmark = pytest.mark.usefixtures("few_steps")


def test_a_folder_becomes_a_table_and_a_page_and_is_not_done_twice(tmp_path, monkeypatch, physic):
    monkeypatch.chdir(tmp_path)
    Path("photos").mkdir()
    Image.fromarray(load_world("stand", (160, 120)).image).save("photos/stand.png")
    Path("photos/broken.jpg").write_text("no photo")
    options = ("photos", "-o", "out", "--preset", "mock", "--save", "people", "--workers", "1")
    done = physic("batch", *options)
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines() == [
        "1 done, 1 failed (1 InputError)",
        f"wrote {tmp_path / 'out' / 'summary.csv'}",
        f"wrote {tmp_path / 'out' / 'people.csv'}",
        f"wrote {tmp_path / 'out' / 'summary.parquet'}",
        f"wrote {tmp_path / 'out' / 'people.parquet'}",
        f"wrote {tmp_path / 'out' / 'contact-sheet.html'}",
    ]
    assert done.stderr.startswith("2 photos: 0 done before; 2 to do: 2 new\n[1/2] failed ")
    with Path("out/summary.csv").open(newline="") as file:
        rows = {Path(row["path"]).name: row for row in csv.DictReader(file)}
    assert (rows["stand.png"]["people"], rows["stand.png"]["state"]) == ("1", "done")
    assert (rows["broken.jpg"]["people"], rows["broken.jpg"]["state"]) == ("", "failed")
    with Path("out/people.csv").open(newline="") as file:
        (person,) = csv.DictReader(file)
    assert (person["id"], person["person"]) == (rows["stand.png"]["id"], "0")
    assert float(person["distance_m"]) > 1
    table = pq.read_table("out/people.parquet")
    assert table.column_names == list(person)
    assert table["distance_m"].to_pylist() == [float(person["distance_m"])]
    people = Path("out", rows["stand.png"]["folder"], "reconstruction.npz")
    assert people.stat().st_size < 500_000
    refused = physic("show", "out")
    assert (refused.exit_code, rows["stand.png"]["folder"] in refused.output) == (3, True)
    journal = Path("out/journal.jsonl").read_text()
    Path("out/people.csv").unlink()
    again = physic("batch", *options)
    assert again.exit_code == 0  # summary.csv and the page of the first run are replaced
    assert len(Path("out/people.csv").read_text().splitlines()) == 2
    assert again.stderr == (
        "2 photos: 1 done before; 1 failed before (--retry failed retries them); 0 to do\n"
    )
    assert Path("out/journal.jsonl").read_text() == journal
    for name in ("x", "y"):
        Path("photos", f"{name}.jpg").write_text("no photo")
    rest = physic("batch", *options, "--limit", "1", "--dry-run")
    assert rest.stdout == f"{tmp_path}/photos/x.jpg\n"
    assert "1 done before; 1 failed before" in rest.stderr


def test_a_dry_run_lists_the_photos_and_writes_nothing(tmp_path, monkeypatch, physic):
    monkeypatch.chdir(tmp_path)
    Path("photos").mkdir()
    Path("photos", "notes.txt").write_text("no photo")
    for name in ("a.jpg", "b.jpg", "c\x1b.jpg"):
        Image.new("RGB", (64, 64)).save(Path("photos", name))
    done = physic("batch", "photos", "-o", "out", "--preset", "mock", "--dry-run")
    assert done.stdout.splitlines() == [
        f"{tmp_path}/photos/{name}.jpg" for name in ("a", "b", "c\\x1b")
    ]
    assert done.stderr == "left out: 1 .txt\n3 photos: 0 done before; 3 to do: 3 new\n"
    assert not Path("out").exists()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with 45 files in ``photos``, which is the current one."""
    monkeypatch.chdir(tmp_path)
    Path("photos").mkdir()
    for index in range(45):
        Path("photos", f"{index}.jpg").write_text("no photo")
    return tmp_path


def rows_of_table():
    try:
        return len(Path("out/summary.csv").read_text().splitlines()) - 1
    except FileNotFoundError:
        return 0


def use_executor(monkeypatch, rows):
    monkeypatch.setattr("physic_batch.run.open_executor", lambda name, settings: rows)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_batch_that_is_stopped_has_its_tables(folder, monkeypatch, name, physic, request):
    number = getattr(signal, name, None)
    if number is None:
        pytest.skip("no such signal")
    if name != "SIGINT":  # under nohup it would be ignored
        request.addfinalizer(partial(signal.signal, number, signal.getsignal(number)))
        signal.signal(number, signal.SIG_DFL)

    def rows(items, job):
        for item in items[:3]:
            yield failed_row(job, item, "Timeout", "no result", 0.0)
        signal.raise_signal(number)
        yield failed_row(job, items[3], "Timeout", "no result", 0.0)

    use_executor(monkeypatch, rows)
    words = ["batch", "photos", "-o", "out", "--preset", "mock"]
    monkeypatch.setattr("sys.argv", ["physic", *words])
    stopped = physic(*words)
    assert stopped.exit_code == 130
    assert rows_of_table() == 3
    assert stopped.stdout.startswith(
        "stopped after 3 of 45 photos: 0 done, 3 failed (3 Timeout); --retry failed"
    )
    assert "contact-sheet.html" in stopped.stdout
    assert f" 3 photos are kept; to continue: physic {' '.join(words)}\n" in stopped.stderr
    assert "42 to do" in physic(*words, "--dry-run").stderr


def failed_rows(items, job):
    for item in items:
        yield failed_row(job, item, "InputError", "no photo", 0.0)


def test_shards_write_their_own_journals_and_one_command_the_tables(folder, monkeypatch, physic):
    use_executor(monkeypatch, failed_rows)
    options = ("photos", "-o", "out", "--preset", "mock")
    for shard in ("1/2", "2/2"):
        done = physic("batch", *options, "--shard", shard)
        assert (done.exit_code, rows_of_table()) == (0, 0)
        assert "physic batch --tables -o" in done.stdout
    written = physic("batch", "--tables", "-o", "out")
    assert (written.exit_code, rows_of_table()) == (0, 45)
    assert "0 to do" in physic("batch", *options, "--dry-run").stderr
    assert "0 to do" in physic("batch", *options, "--shard", "2/3", "--dry-run").stderr
    Path("out/journal-1-of-2.jsonl").unlink()
    assert "0 to do" in physic("batch", *options, "--shard", "2/2", "--dry-run").stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--tables", "photos"), "--tables takes no photos"),
        ((), "name photos"),
        (("--tables",), "no journal in out: name the output folder of a batch"),
    ],
)
def test_photos_or_tables_are_named(folder, physic, arguments, words):
    refused = physic("batch", *arguments, "-o", "out")
    assert refused.exit_code in (2, 3)
    assert words in refused.stderr


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("nowhere.png,,,", "nowhere.png: there is no such file"),
        ("empty.png,,,", "the file is empty"),
        (
            "photo.png,nowhere.npy,,",
            "settings of this photo: photo.depth: cannot read {folder}/nowhere.npy: there is no "
            "such file",
        ),
        ("photo.png,flat.npy,,", "flat.npy"),
        ("photo.png,,flat.npy,", "flat.npy"),
        ('photo.png,,,"1.7,1.8,1.6"', "3 statures were given for 2 people"),
        ("photo.png,depth.npy,points.npy,1.7", ""),
    ],
)
def test_a_dry_run_says_which_photos_will_fail(tmp_path, monkeypatch, physic, row, words):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(load_world("stand", (160, 120)).image).save("photo.png")
    Path("empty.png").touch()
    np.save("depth.npy", np.full((120, 160), 3.0))
    np.save("points.npy", np.full((120, 160, 3), 3.0))
    np.save("flat.npy", np.full(160, 3.0))
    Path("table.csv").write_text(f"path,depth,pointmap,stature\n{row}\n")
    options = ("--preset", "mock", "--set", "photo.person=[[9,9],[99,9]]", "--dry-run")
    done = physic("batch", "table.csv", "-o", "out", *options)
    assert done.exit_code == 0, done.output
    assert len(done.stdout.splitlines()) == 1
    assert ("1 of 1 photos will fail" in done.stderr) == bool(words)
    assert words.format(folder=tmp_path) in done.stderr
    assert not Path("out").exists()
