"""Writes that are interrupted at each of their steps: afterwards there is what was there before, or the new files."""

from __future__ import annotations

import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import physic_core.io.report_file as report_file
import physic_core.io.results as results
from fuzzing.interrupted import Steps
from fuzzing.tiny_result import difference, tiny_result
from physic_core.batch.journal import Journal, read_rows
from physic_core.batch.saving import Saving, save_photo
from physic_core.errors import InputError, OutputError
from physic_core.files.archive import write_archive
from physic_core.files.atomic import COMMIT_FILE, atomic_write
from physic_core.io.results import load_reconstruction, save_reconstruction
from physic_core.types import Reconstruction

OLD, NEW = tiny_result(0), tiny_result(1)
NEW = replace(NEW, people=NEW.people[:1], photo=OLD.photo, checks=())


def mark(result: Reconstruction) -> str:
    return str(result.diagnostics["joint"]["seed"])


@pytest.fixture(autouse=True)
def quick_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures and pages that name their result, in place of rendered ones."""

    def pictures(result: Reconstruction, *, preview: bool, glb: bool) -> tuple[dict[str, bytes], None]:
        names = ["scene.glb", *(f"person_{i}.glb" for i in range(len(result.people)))] * glb + ["preview.png"] * preview
        return {name: f"picture of {mark(result)}".encode() for name in names}, None

    monkeypatch.setattr(results, "_pictures", pictures)
    page = f"<meta {report_file.PAGE_MARK}> page of "
    monkeypatch.setattr(report_file, "report_html", lambda result, title: page + mark(result))


def save(folder: Path, result: Reconstruction) -> None:
    save_reconstruction(result, folder)


def save_compact(folder: Path, result: Reconstruction) -> None:
    save_photo(result, folder, Saving("numbers"))


def save_people(folder: Path, result: Reconstruction) -> None:
    save_photo(result, folder, Saving("people"))


def add_page(folder: Path, result: Reconstruction) -> None:
    if not (folder / "reconstruction.json").exists():
        save_reconstruction(OLD, folder)
    report_file.add_report(folder, result)


def write_page(folder: Path, result: Reconstruction) -> None:
    report_file.save_report(result, folder / "a.html")


def write_cache(folder: Path, result: Reconstruction) -> None:
    write_archive(folder / "a.answer.npz", {"image": result.image}, {"seed": mark(result)})


def export(folder: Path, result: Reconstruction) -> None:
    result.export(str(folder / "a.obj"), overwrite=True)


OPERATIONS = [save, save_compact, save_people, add_page, write_page, write_cache, export]
RESULTS = (save, save_compact)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def interruptions(
    operation: Callable[[Path, Reconstruction], None], before: Path | None, tmp_path: Path, how: str
) -> Iterator[Path]:
    """Interrupt the operation at each of its steps, in a copy of the folder, and yield that.

    With ATTACK_EVERY_STEP set, each single write of a file of many writes is a step.
    """

    def run(number: int | None) -> Steps:
        shutil.copytree(before, folder) if before else folder.mkdir()
        steps = Steps(folder, number, how)
        with steps.applied(), suppress(OutputError):
            operation(folder, NEW)
        return steps

    folder = tmp_path / how
    counted = run(None)
    shutil.rmtree(folder)
    numbers = range(counted.count) if "ATTACK_EVERY_STEP" in os.environ else counted.chosen()
    assert numbers
    for number in numbers:
        assert run(number).count > number
        yield folder
        shutil.rmtree(folder)


def made(operation: Callable[[Path, Reconstruction], None], folder: Path, *of: Reconstruction) -> dict[str, bytes]:
    folder.mkdir()
    for result in of:
        operation(folder, result)
    return files(folder)


@pytest.mark.parametrize(
    ("operation", "how"),
    [
        pytest.param(operation, how, id=f"{operation.__name__}-{how}")
        for operation in OPERATIONS
        for how in ("killed", "power", "full")
        # A loss of power may damage a file of the cache, which is verified when it is read.
        if (operation, how) != (write_cache, "power")
    ],
)
def test_a_write_happens_completely_or_not_at_all(operation: Any, how: str, tmp_path: Path):
    old, new = made(operation, tmp_path / "old", OLD), made(operation, tmp_path / "new", OLD, NEW)
    assert old != new
    seen = set()
    for folder in interruptions(operation, tmp_path / "old", tmp_path, how):
        if operation in RESULTS:
            assert_complete(folder)
        if how == "full":
            assert not list(folder.glob(".*"))  # what failed is cleaned at once
        if how == "killed" and operation in RESULTS:
            again = shutil.copytree(folder, tmp_path / "again")
            operation(again, NEW)  # without a cleanup by the user
            assert files(again) == new
            shutil.rmtree(again)
        with atomic_write(folder):
            pass  # the next write finishes or cleans up what the killed process has left
        found = files(folder)
        assert found in (old, new), f"{operation.__name__}: {sorted(found)}"
        seen.add(found == new)
    assert seen == {False} or (how != "full" and seen == {False, True})


def assert_complete(folder: Path) -> None:
    """The result is the old or the new one, and no visible file is of another one than those beside it."""
    loaded = load_reconstruction(folder)
    assert mark(loaded) in (mark(OLD), mark(NEW))
    whole = OLD if mark(loaded) == mark(OLD) else NEW
    assert not difference(loaded.people[0].mask, whole.people[0].mask)
    assert len(loaded.people) == len(whole.people)
    marks = set()
    for path in folder.glob("[!.]*"):
        if path.suffix in (".glb", ".png", ".html"):
            marks.add(path.read_bytes().split()[-1].decode())
        elif path.name == "reconstruction.json":
            marks.add(mark(OLD) if f'"seed": {mark(OLD)}' in path.read_text(encoding="utf-8") else mark(NEW))
    assert len(marks) <= 1, marks


@pytest.mark.skipif(sys.platform == "win32", reason="a folder cannot be synchronised")
def test_the_commit_file_is_on_the_disk_before_a_file_is_renamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """After a loss of power, a file system may have kept any of the renames after the last one of these."""
    steps: list[str] = []
    fsync, replace_file = os.fsync, os.replace

    def note_sync(file: int) -> None:
        steps.append("sync folder" if stat.S_ISDIR(os.fstat(file).st_mode) else "sync file")
        fsync(file)

    def note_rename(source: Any, target: Any) -> None:
        steps.append(f"rename to {Path(target).name}")
        replace_file(source, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "replace", note_rename)
    with atomic_write(tmp_path) as temporary:
        for name in "ab":
            temporary(name).write_text("new")
    committed = steps.index(f"rename to {COMMIT_FILE}")
    assert steps[:committed] == ["sync file"] * 3
    assert steps[committed + 1] == "sync folder"
    assert {"rename to a", "rename to b"} <= set(steps[committed + 2 :])
    assert steps[-1] == "sync folder"


@pytest.mark.parametrize("how", ["killed", "power", "full"])
def test_a_first_result_is_complete_or_not_there(how: str, tmp_path: Path):
    found = set()
    for folder in interruptions(save, None, tmp_path, how):
        try:
            found.add(mark(load_reconstruction(folder)))
        except InputError as error:
            found.add(str(error).partition(": ")[2])
        save_reconstruction(OLD, folder)
        assert mark(load_reconstruction(folder)) == mark(OLD)
        assert not list(folder.glob(".*"))
    assert found == {"there is no such file; name the folder of a finished run"} | (
        {mark(NEW)} if how != "full" else set()
    )


@pytest.mark.parametrize("how", ["killed", "full"])
def test_a_row_of_the_journal_is_there_or_not(how: str, tmp_path: Path):
    rows = [{"id": name, "state": "done", "config": "1", "finished": name} for name in "abc"]

    def append(folder: Path, _: Reconstruction) -> None:
        with Journal(folder / "journal.jsonl") as journal:
            journal.append(rows[1])

    (tmp_path / "old").mkdir()
    with Journal(tmp_path / "old" / "journal.jsonl") as journal:
        journal.append(rows[0])
    for folder in interruptions(append, tmp_path / "old", tmp_path, how):
        found = read_rows(folder, rows[0])
        assert found in ({"a": rows[0]}, {"a": rows[0], "b": rows[1]})
        with Journal(folder / "journal.jsonl") as journal:
            journal.append(rows[2])
        assert read_rows(folder, rows[0]) == {**found, "c": rows[2]}


@pytest.mark.parametrize(
    "commit",
    [
        '{"rename": {"../x": ".../x.00000000.physic-part"}, "delete": {"../mine": [4, 0]}}',
        '{"rename": {"mine": "../mine"}, "delete": {"/etc/x": [0, 0]}}',
        '{"rename": {"mine": ".other.00000000.physic-part"}, "delete": {"mine": [4, 0]}}',
        '{"rename": [], "delete": 3}',
        "[" * 100_000,
        "",
    ],
)
def test_a_commit_file_of_another_moves_and_deletes_nothing(commit: str, tmp_path: Path):
    folder = tmp_path / "folder"
    folder.mkdir()
    for path in (tmp_path / "mine", folder / "mine"):
        path.write_text("mine")
    (folder / COMMIT_FILE).write_text(commit)
    with atomic_write(folder) as temporary:
        temporary("a").write_text("a")
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "mine"}
    assert files(folder) == {"mine": b"mine", "a": b"a"}


def test_a_changed_file_is_not_deleted(tmp_path: Path):
    (tmp_path / "page").write_text("old")
    with atomic_write(tmp_path) as temporary:
        temporary("a").write_text("a")
        temporary.remove("page")
        temporary.remove("missing")
        os.utime(tmp_path / "page", ns=(1, 1))
    assert set(files(tmp_path)) == {"a", "page"}


def test_old_temporary_files_of_a_user_stay(tmp_path: Path):
    own = {".mine.part", ".x.deadbeef.part", ".mine.physic-part", "a.0123abcd.physic-part"}
    for name in own:
        (tmp_path / name).write_text("mine")
    (tmp_path / ".a.0123abcd.physic-part").write_text("left behind")
    with atomic_write(tmp_path) as temporary:
        temporary("a").write_text("a")
    assert set(files(tmp_path)) == {"a", *own}
