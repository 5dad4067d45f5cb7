"""A batch that is interrupted, resumed and changed: every photo has one valid row, and nothing is
done twice.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from physic_batch.contact_sheet import write_contact_sheet
from physic_batch.journal import (
    COLUMNS,
    Journal,
    JournalIndex,
    journal_files,
    read_journals,
    write_tables,
)
from physic_batch.photo_processor import BatchJob, PhotoProcessor, base_row
from physic_batch.photos import list_photos
from physic_batch.run import plan_batch, run_batch
from physic_core.configuration.model import load_config
from physic_core.discovery.entry_points import core_version
from physic_core.errors import InputError, OutputError
from physic_core.io.result_folder import file_digest
from tests.rooms import tiny_result

from .conftest import STANDIN


def make_photos(folder, *names):
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / f"{name}.jpg").write_bytes(os.fsencode(name))
    return folder


def lines(out):
    return [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()]


def states(out):
    return {
        Path(row["path"]).stem: (row["state"], row["error"]) for row in read_journals(out).values()
    }


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


# ---- faults
# --------------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_bad_photos_are_rows_with_their_reason(standin, tmp_path, out):
    photos = make_photos(tmp_path / "photos", "a", "abort", "b", "broken", "hang", "nobody")
    standin.run_standin(photos, out, workers=1, timeout=2.0)
    assert states(out) == {
        "a": ("done", ""),
        "b": ("done", ""),
        "abort": ("failed", "WorkerDied"),
        "broken": ("failed", "ValueError"),
        "hang": ("failed", "Timeout"),
        "nobody": ("failed", "NoPersonError"),
    }
    rows = {Path(row["path"]).stem: row for row in lines(out)}
    assert len(rows) == 6
    assert rows["broken"]["message"] == "three lines here"
    assert (rows["abort"]["attempts"], rows["hang"]["attempts"]) == (2, 1)
    assert all(COLUMNS.keys() <= row.keys() for row in rows.values())
    assert rows["a"].keys() - COLUMNS.keys() == {
        "people",
        "people_rows",
        "load_seconds",
        "focal_px",
        "scene_scale",
    }
    assert rows["broken"]["photo"].startswith("sha256:")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_after_a_kill_of_the_parent_the_same_command_does_the_rest(tmp_path, out):
    photos = make_photos(tmp_path / "photos", *(f"photo{i}" for i in range(12)))
    command = [sys.executable, str(STANDIN / "batch_standin.py"), str(photos), str(out), "0.3"]
    with subprocess.Popen(command) as parent:
        while (
            not (out / "journal.jsonl").exists()
            or len((out / "journal.jsonl").read_bytes().splitlines()) < 3
        ):
            assert parent.poll() is None
            time.sleep(0.05)
        parent.send_signal(signal.SIGKILL)
    first = lines(out)
    assert 3 <= len(first) < 12
    with (out / "journal.jsonl").open("ab") as file:
        file.write(b'{"id": "torn", "sta')  # as a full disk leaves it
    subprocess.run(command, check=True, timeout=300)
    rows = [
        json.loads(line)
        for line in (out / "journal.jsonl").read_text().splitlines()
        if "torn" not in line
    ]
    assert Counter(Path(row["path"]).stem for row in rows) == {f"photo{i}": 1 for i in range(12)}
    assert {row["state"] for row in rows} == {"done"}
    subprocess.run(command, check=True, timeout=300)
    assert len((out / "journal.jsonl").read_text().splitlines()) == 13


def test_a_full_disk_ends_the_batch_without_a_row_for_its_photo(standin, tmp_path, out):
    photos = make_photos(tmp_path / "photos", "a", "full")
    with pytest.raises(OutputError, match="No space left on device"):
        standin.run_standin(photos, out, workers=1)
    assert states(out) == {"a": ("done", "")}
    (photos / "full.jpg").rename(photos / "roomy.jpg")
    standin.run_standin(photos, out, workers=1)
    assert states(out) == {"a": ("done", ""), "roomy": ("done", "")}


# ---- the journal
# --------------------------------------------------------------------------------------------------


def row(name, finished="2026-01-01T00:00:00", **more):
    return {"id": name, "state": "done", "config": "c", "finished": finished, **more}


def test_the_last_row_of_an_id_counts_and_torn_lines_do_not(tmp_path):
    with Journal(tmp_path / "journal.jsonl") as journal:
        journal.append(row("a", value=float("nan")))
        journal.append(row("b"))
        journal.append(row("a", "2026-01-02T00:00:00", value=1.0 / 3))
    with (tmp_path / "journal.jsonl").open("ab") as file:
        odd = {"id": ["x"], "state": "done", "config": "c", "finished": "f"}
        file.write(json.dumps(odd).encode() + b"\nnull\n\x00\xff\n")
        file.write(b"[" * 100_000 + b'\n{"id": "c", "state": "do')
    with Journal(tmp_path / "journal.jsonl") as journal:
        journal.append(row("d"))
    assert list(read_journals(tmp_path)) == ["b", "a", "d"]
    assert read_journals(tmp_path)["a"]["value"] == pytest.approx(1 / 3)
    assert JournalIndex(journal_files(tmp_path)).damaged == 5
    assert read_journals(tmp_path, ("state", "run"))["d"] == {
        "id": "d",
        "state": "done",
        "run": 2,
    }


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("people_rows", '"abc"'),
        ("seconds", '"high"'),
        ("run", "[]"),
        ("people", "{}"),
        ("stamp", "null"),
        *(("people", number) for number in ("NaN", "1e400", "-1e400", '"Infinity"')),
        ("people", f"1{'0' * 400}"),
        ("usable_pose", f"-1{'0' * 400}"),
    ],
)
def test_a_row_with_a_value_of_another_type_or_that_is_not_finite_is_skipped_and_counted(
    tmp_path, name, value
):
    with Journal(tmp_path / "journal.jsonl") as journal:
        journal.append(row("a", seconds=0.5))
    with (tmp_path / "journal.jsonl").open("a") as file:
        line = json.dumps(row("a", seconds=0.9, run=1) | {name: "VALUE"})
        file.write(line.replace('"VALUE"', value) + "\n")
    index = JournalIndex(journal_files(tmp_path))
    assert [found and found["seconds"] for found in index.rows(["a"])] in ([0.5], [None])
    assert index.damaged == 1
    write_tables(tmp_path)
    write_contact_sheet(tmp_path)


@pytest.mark.parametrize("names", [("1-of-2", "2-of-2"), ("2-of-2", "1-of-2")])
def test_of_several_journals_the_later_run_counts_whatever_its_clock_says(tmp_path, names):
    for value, name in enumerate(names):
        with Journal(tmp_path / f"journal-{name}.jsonl") as journal:
            journal.append(row(f"only {name}"))
            journal.append(row("both", f"2026-01-0{9 - value}T00:00:00", value=value))
    found = read_journals(tmp_path)
    assert sorted(found) == ["both", "only 1-of-2", "only 2-of-2"]
    assert found["both"]["value"] == 1


@pytest.mark.skipif(sys.platform == "win32", reason="no locks")
def test_two_batches_cannot_write_one_journal(tmp_path):
    path = tmp_path / "journal.jsonl"
    with Journal(path), pytest.raises(OutputError, match="another batch is writing"):
        Journal(path)
    with Journal(path):
        pass


# ---- what is done anew
# -----------------------------------------------------------------------------------------------


def finished(job, photos, failed=(), **more):
    """Write a row for every photo, as a run would; those of some ids failed."""
    Path(job.out).mkdir(exist_ok=True)
    with Journal(Path(job.out) / "journal.jsonl") as journal:
        for item in list_photos([str(photos)]).photos:
            journal.append(
                base_row(job, item.stamped())
                | {"state": "failed" if item.id in failed else "done"}
                | {"photo": file_digest(item.path)}
                | more
            )


def job_for(out, *overrides, level="none"):
    return BatchJob(
        load_config(preset="mock", overrides=overrides), str(out), level, with_thumbnails=False
    )


def todo(job, photos, **options):
    return [
        Path(item.path).stem
        for item in plan_batch(list_photos([str(photos)]).photos, job, **options).todo
    ]


OWN_DEPTH = """
from physic_mock.depths import MetricDepthOptions, MockMetricDepth

class Options(MetricDepthOptions):
    weights: str = ""

class Own(MockMetricDepth):
    Options = Options
"""
TABLE = "path,depth,bodies,masks,id\na.jpg,depth.npy,a.npz,,a\nb.jpg,,,masks.npz,b\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Two photos, a and b, with all that their results depend on."""
    monkeypatch.setattr("physic_core.cache.digests._STARTED", float("inf"))
    make_photos(tmp_path, "a", "b")
    files = ("depth.npy", "points.npy", "a.npz", "masks.npz", "weights.bin", "body.npz")
    for name in files:
        (tmp_path / name).write_text("one")
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "own_depth.py").write_text(OWN_DEPTH)
    (tmp_path / "table.csv").write_text(TABLE)
    yield tmp_path
    sys.modules.pop("own_depth", None)


def plan_of(place, *overrides, level="none"):
    settings = {
        "photo.pointmap": place / "points.npy",
        "body_model.path": place / "body.npz",
        "metric_depth.backend": f"{place / 'own' / 'own_depth'}:Own",
        "metric_depth.options.weights": place / "weights.bin",
    }
    chosen = [f"{name}='{value}'" for name, value in settings.items()]
    job = job_for(place / "out", *chosen, *overrides, level=level)
    return job, plan_batch(list_photos([str(place / "table.csv")]).photos, job)


def rewritten(name, text):
    """Give a file other content of the same size, with the same modification time."""

    def change(place, patch):
        before = (place / name).stat()
        (place / name).write_text(text)
        os.utime(place / name, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert (place / name).stat().st_size == before.st_size

    return change


def in_file(name, old, new):
    def change(place, patch):
        text = (place / name).read_text()
        assert old in text
        (place / name).write_text(text.replace(old, new))

    return change


def another_library(place, patch):
    patch.setattr("physic_core.cache.results.required_versions", lambda name: {"numpy": "99.0"})


CORE, OLD_CORE = (f'"version": "{one}"' for one in (core_version(), "0.0.9"))
MOCK, OLD_MOCK = (f"metricbody-testing {one}" for one in (version("metricbody-testing"), "0.0.9"))
CHANGES = [
    ("photo of the same size and time", "a", "photo changed", rewritten("a.jpg", "A")),
    ("setting", "ab", "with other settings", ("photo.max_side=640",)),
    ("cell", "b", "with other settings", in_file("table.csv", "b.jpg,,", "b.jpg,points.npy,")),
    ("file of a cell", "a", "with other settings", rewritten("depth.npy", "two")),
    ("masks of a cell", "b", "with other settings", rewritten("masks.npz", "two")),
    ("file of the photo", "ab", "with other settings", rewritten("points.npy", "two")),
    ("weights", "ab", "with other settings", rewritten("weights.bin", "two")),
    ("body", "ab", "with other settings", rewritten("body.npz", "two")),
    ("core", "ab", "made by metricbody 0.0.9", in_file("out/journal.jsonl", CORE, OLD_CORE)),
    (
        "plugin",
        "ab",
        "made by metricbody-testing 0.0.9",
        in_file("out/journal.jsonl", MOCK, OLD_MOCK),
    ),
    ("code", "ab", "made by other code", in_file("own/own_depth.py", '""', '"x"')),
    ("library", "ab", "made by other code", another_library),
]


@pytest.mark.parametrize(
    ("photos", "reason", "change"), [c[1:] for c in CHANGES], ids=[c[0] for c in CHANGES]
)
def test_every_change_is_noticed_and_does_its_photos_anew(
    place, monkeypatch, photos, reason, change
):
    job, plan = plan_of(place)
    assert plan.reasons == {"new": 2}
    finished(job, place / "table.csv", failed="b")
    assert plan_of(place)[1].todo == ()
    overrides = change if isinstance(change, tuple) else change(place, monkeypatch) or ()
    _, plan = plan_of(place, *overrides)
    assert "".join(item.id for item in plan.todo) == photos
    ((why, number),) = plan.reasons.items()
    assert why.startswith(reason)
    assert number == len(photos)


def test_what_changes_no_result_does_no_photo_anew(place):
    job, _ = plan_of(place)
    finished(job, place / "table.csv")
    for name in ("a.jpg", "depth.npy", "weights.bin"):
        content = (place / name).read_bytes()
        (place / name).unlink()
        (place / name).write_bytes(content)
    (place / "own" / "__pycache__").mkdir(exist_ok=True)
    overrides = ("run.threads=2", "run.cache=false", "run.low_memory=true")
    assert plan_of(place, *overrides)[1].todo == ()


def test_what_is_saved_is_enough_or_said(place):
    job, _ = plan_of(place)
    finished(job, place / "table.csv", save="numbers")
    assert plan_of(place, level="pictures")[1].reasons == {"saved as numbers": 2}


def run_all(photos, job, reconstruct=lambda path, settings: tiny_result()):
    """Do all photos in this process, by default with the same small result, and return the last
    row.
    """
    process = PhotoProcessor(job, reconstruct)
    todo = list_photos([str(photos)]).photos
    run_batch(
        todo,
        job,
        lambda items, job: (process(item) for item in items),
        Path(job.out) / "journal.jsonl",
    )
    return list(read_journals(Path(job.out)).values())[-1]


@pytest.fixture
def quick_mesh(monkeypatch):
    monkeypatch.setattr("physic_visual.pictures.combined_glb", lambda result: b"mesh")


@pytest.mark.usefixtures("quick_mesh")
@pytest.mark.parametrize("save", ["pictures", "numbers", "people"])
def test_each_file_that_is_lost_is_made_again(tmp_path, out, save):
    photos = make_photos(tmp_path / "photos", "a")
    job = BatchJob(load_config(preset="mock"), str(out), save)
    found = run_all(photos, job)
    sizes = dict(text.split("=") for text in found["files"].split())
    assert sizes == {
        "thumbnail" if path.suffix == ".jpg" else path.name: str(path.stat().st_size)
        for kind in ("photos", "thumbnails")
        for path in out.glob(f"{kind}/*/**/*.*")
    }
    assert todo(job, photos) == []
    for path in out.glob("photos/*/*/*"):
        content = path.read_bytes()
        for damaged in (b"", content[: len(content) // 2]):
            path.unlink()
            if damaged:
                path.write_bytes(damaged)
            plan = plan_batch(list_photos([str(photos)]).photos, job)
            lost = not damaged or path.name.startswith("reconstruction")  # a picture may be edited
            assert (path.name, len(plan.todo), sum(plan.reasons.values())) == (
                path.name,
                lost,
                lost,
            )
            path.write_bytes(content)
    assert todo(job, photos) == []


def test_a_result_without_its_row_is_done_again(tmp_path, out):
    """A batch that was killed between a result and its row leaves this."""
    photos = make_photos(tmp_path / "photos", "a", "b")
    job = BatchJob(load_config(preset="mock"), str(out), "numbers")
    run_all(photos, job)
    journal = out / "journal.jsonl"
    first, _ = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(first)
    assert len(list(out.glob("photos/*/*/reconstruction.json"))) == 2
    assert todo(job, photos) == ["b"]


def test_a_photo_that_is_replaced_while_it_is_read_is_done_again(tmp_path, out):
    photos = make_photos(tmp_path / "photos", "done", "failed")
    job = job_for(out)

    def replaced(path, settings):
        Path(path).write_bytes(b"X" * len(Path(path).read_bytes()))
        if "failed" in path:
            raise InputError("damaged")
        return replace(tiny_result(), photo=f"sha256:{hashlib.sha256(b'done').hexdigest()}")

    run_all(photos, job, replaced)
    assert sorted(todo(job, photos)) == ["done", "failed"]


def test_failed_photos_are_tried_again_with_retry(tmp_path, out):
    photos = make_photos(tmp_path / "photos", "a")
    job = job_for(out)
    finished(job, photos, state="failed", error="NoPersonError")
    plan = plan_batch(list_photos([str(photos)]).photos, job)
    assert (plan.todo, plan.failed, plan.done) == ((), {"NoPersonError": 1}, 0)
    assert todo(job, photos, retry_failed=True) == ["a"]
