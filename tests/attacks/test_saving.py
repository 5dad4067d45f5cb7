"""Writes that are interrupted at each of their steps: a result is the old one, the new one, or
refused.
"""

from __future__ import annotations

import shutil
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from interrupted import Steps
from physic_batch.journal import Journal, read_journals
from physic_core.errors import InputError, OutputError
from physic_core.files.atomic import atomic_write
from physic_core.io.report_file import add_report, save_report
from physic_core.io.results import load_reconstruction, save_reconstruction
from physic_core.pictures import PAGE_MARK
from physic_scene import output
from physic_scene.types import SceneCamera, SceneResult, SolvedPhoto
from physic_visual import pictures
from tests.rooms import tiny_result

OLD = tiny_result(0)
NEW = tiny_result(1)
NEW = replace(NEW, people=NEW.people[:1], photo=OLD.photo, checks=())


def mark(result):
    return str(result.diagnostics["joint"]["seed"])


@pytest.fixture(autouse=True)
def quick_pictures(monkeypatch):
    """Pictures and pages that name their result, in place of rendered ones."""

    monkeypatch.setattr(pictures, "combined_glb", lambda result: f"mesh of {mark(result)}".encode())
    monkeypatch.setattr(
        pictures, "preview_png", lambda result: f"picture of {mark(result)}".encode()
    )
    monkeypatch.setattr(
        output, "photos_png", lambda scene: f"photos of {mark(scene.reconstruction)}".encode()
    )
    page = f"<meta {PAGE_MARK}> page of "
    monkeypatch.setattr(pictures, "report_html", lambda result, title: page + mark(result) + title)


def save(folder, result):
    save_reconstruction(result, folder)


def save_compact(folder, result):
    save_reconstruction(result, folder, "numbers", overwrite=True)


def save_people(folder, result):
    save_reconstruction(result, folder, "people", overwrite=True)


def save_moment(folder, result):
    camera = SceneCamera(np.eye(3), np.zeros(3), result.intrinsics, 0.0, 0.0)
    photo = SolvedPhoto(0, f"photo {mark(result)}.jpg", camera, {}, 0.0, 1.0, result)
    moment = SceneResult(result, 0, (photo,), ())
    output.save_scene(moment, str(folder), overwrite=True, page=f"page of {mark(result)}")


def add_page(folder, result):
    if not (folder / "reconstruction.json").exists():
        save_reconstruction(OLD, folder)
    add_report(folder, f" of {mark(result)}")


def write_page(folder, result):
    save_report(result, folder / "a.html")


def export(folder, result):
    result.export(str(folder / "a.obj"), overwrite=True)


RESULTS = (save, save_compact, save_people, save_moment)
REFUSED = "there is no such file; name the folder of a finished run"
UNFINISHED = "the result is unfinished"


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def interruptions(operation, before, tmp_path, how):
    """Interrupt the operation at its steps, in a copy of the folder, and yield that."""

    def run(number):
        shutil.copytree(before, folder) if before else folder.mkdir()
        steps = Steps(folder, number, how)
        with steps.applied(), suppress(OutputError, KeyboardInterrupt):
            operation(folder, NEW)
        return steps

    folder = tmp_path / how
    counted = run(None)
    shutil.rmtree(folder)
    numbers = counted.chosen()
    assert numbers
    for number in numbers:
        assert run(number).count > number
        yield folder
        shutil.rmtree(folder)


def made(operation, folder, *of):
    folder.mkdir()
    for result in of:
        operation(folder, result)
    return files(folder)


@pytest.mark.parametrize(
    ("operation", "how"),
    [
        pytest.param(operation, how, id=f"{operation.__name__}-{how}")
        for operation in (*RESULTS, write_page, export)
        for how in ("killed", "full")
    ],
)
def test_a_write_happens_completely_or_not_at_all(operation, how, tmp_path):
    old = made(operation, tmp_path / "old", OLD)
    new = made(operation, tmp_path / "new", OLD, NEW)
    assert old != new
    seen = set()
    for folder in interruptions(operation, tmp_path / "old", tmp_path, how):
        found = {
            name: content for name, content in files(folder).items() if not name.startswith(".")
        }
        if operation in RESULTS and "reconstruction.json" not in found:
            assert how != "full"
            seen.add(REFUSED)
        elif operation == export and found["a.obj"] == old["a.obj"]:  # comes last
            assert all(content in (old.get(name), new.get(name)) for name, content in found.items())
            seen.add("old")
        else:
            assert found in (old, new), f"{operation.__name__}: {sorted(found)}"
            seen.add("new" if found == new else "old")
        if how == "full":
            assert not list(folder.glob(".*"))  # what failed is cleaned at once
        else:
            operation(folder, NEW)  # without a cleanup by the user
            assert files(folder) == new
    # The last step of a single file is its rename: nothing comes after it.
    assert seen - {"new"} == (
        {"old", REFUSED} if operation in RESULTS and how == "killed" else {"old"}
    )


def refused_run(folder):
    """Run another photo into the folder, whose result it may not replace."""
    with pytest.raises(OutputError, match="the result of another photo"):
        save_reconstruction(replace(NEW, photo="sha256:1"), folder, "numbers")


@pytest.mark.parametrize("operation", [save, save_compact, save_moment])
def test_the_next_run_completes_the_result_of_a_killed_process_and_says_so(
    operation, tmp_path, caplog
):
    made(operation, tmp_path / "old", OLD)
    new = made(operation, tmp_path / "new", OLD, NEW)
    completed = 0
    for folder in interruptions(operation, tmp_path / "old", tmp_path, "killed"):
        was_torn = not (folder / "reconstruction.json").exists()
        caplog.clear()
        refused_run(folder)
        assert ("which was completed" in caplog.text) == was_torn
        if was_torn:
            completed += 1
            assert files(folder) == new
            assert mark(load_reconstruction(folder)) == mark(NEW)
    assert completed > 1


def test_the_next_run_keeps_a_file_that_the_user_edited_before_the_process_was_killed(tmp_path):
    save(tmp_path / "old", OLD)
    (tmp_path / "old" / "preview.png").write_text("mine")
    for folder in interruptions(save, tmp_path / "old", tmp_path, "killed"):
        refused_run(folder)
        kept = [path for path in folder.glob("preview*.png") if path.read_text() == "mine"]
        assert len(kept) == 1


@pytest.mark.parametrize("how", ["killed", "interrupted", "full"])
@pytest.mark.parametrize("before", [save, add_page])
def test_a_page_that_is_interrupted_at_any_step_costs_no_result(before, how, tmp_path):
    before(tmp_path / "old", OLD)
    old = files(tmp_path / "old").get("report.html")
    pages = set()
    for folder in interruptions(add_page, tmp_path / "old", tmp_path, how):
        assert mark(load_reconstruction(folder)) == mark(OLD)
        found = files(folder)
        pages.add(found.get("report.html"))
        assert {name: found[name] for name in ("preview.png", "combined.glb")} == {
            name: (tmp_path / "old" / name).read_bytes() for name in ("preview.png", "combined.glb")
        }
    new = f"<meta {PAGE_MARK}> page of {mark(OLD)} of {mark(NEW)}".encode()
    assert pages == ({old} if how == "full" else {old, new})


def test_a_file_of_the_user_in_the_folder_of_a_killed_run_is_never_replaced(tmp_path):
    save(tmp_path / "old", OLD)
    refused = 0
    for folder in interruptions(save, tmp_path / "old", tmp_path, "killed"):
        if not (folder / "reconstruction.json").exists():
            refused += 1
            (folder / "combined.glb").unlink(missing_ok=True)
            (folder / "combined.glb").write_text("mine")
            (folder / "person_7.glb").write_text("mine")
            save(folder, NEW)
            assert (
                (folder / "combined.edited.glb").read_text()
                == (folder / "person_7.glb").read_text()
                == "mine"
            )
            assert mark(load_reconstruction(folder)) == mark(NEW)
    assert refused


@pytest.mark.parametrize("how", ["killed", "full"])
def test_a_first_result_is_complete_or_not_there(how, tmp_path):
    found = set()
    for folder in interruptions(save, None, tmp_path, how):
        try:
            found.add(mark(load_reconstruction(folder)))
        except InputError as error:
            found.add(str(error).partition(": ")[2].partition(", since")[0])
        save_reconstruction(OLD, folder)
        assert mark(load_reconstruction(folder)) == mark(OLD)
        assert not list(folder.glob(".*"))
    assert found - {mark(NEW)} == {REFUSED, *([UNFINISHED] if how == "killed" else [])}


@pytest.mark.parametrize("how", ["killed", "full"])
def test_a_row_of_the_journal_is_there_or_not(how, tmp_path):
    rows = [{"id": name, "state": "done", "config": "1", "finished": name} for name in "abc"]

    def append(folder, row):
        with Journal(folder / "journal.jsonl") as journal:
            journal.append(row)

    (tmp_path / "old").mkdir()
    append(tmp_path / "old", rows[0])
    for folder in interruptions(
        lambda folder, _: append(folder, rows[1]), tmp_path / "old", tmp_path, how
    ):
        found = read_journals(folder, rows[0])
        assert found in ({"a": rows[0]}, {"a": rows[0], "b": rows[1]})
        append(folder, rows[2])
        assert read_journals(folder, rows[0]) == {**found, "c": rows[2]}


def test_old_temporary_files_of_a_user_stay(tmp_path):
    own = {".mine.part", ".x.deadbeef.part", ".mine.physic-part", "a.0123abcd.physic-part"}
    for name in own:
        (tmp_path / name).write_text("mine")
    (tmp_path / ".a.0123abcd.physic-part").write_text("left behind")
    with atomic_write(tmp_path) as temporary:
        temporary("a").write_text("a")
    assert set(files(tmp_path)) == {"a", *own}
