"""Each kind of interruption at each step of a write: what was written before is whole, or what is
written now, also of two writers; and an error is never taken for success.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from interrupted import Steps
from physic_batch.journal import Journal, read_journals
from physic_core.errors import OutputError
from physic_core.files.atomic import atomic_write, is_part, write_own
from physic_core.files.serialization import write_value
from physic_core.io.result_folder import (
    add_result_files,
    digest_of,
    file_digest,
    prepare_result_folder,
    run_of_document,
    write_result_files,
)
from physic_core.io.results import load_reconstruction, save_reconstruction
from tests.rooms import tiny_result

HOWS = ("killed", "interrupted", "ENOSPC", "EDQUOT", "ESTALE", "EROFS", "ENOENT")
OLD = {"reconstruction.npz": b"old", "people.csv": b"old", "preview.png": b"old", "a/b.txt": b"old"}
NEW = {"reconstruction.npz": b"new", "people.csv": b"new", "c/d.txt": b"new"}
HIDDEN = ".result.physic.old"


def result(folder, contents=NEW):
    prepare_result_folder(folder, "")
    document = {"schema": "physic-reconstruction", "digest": digest_of(contents["people.csv"])}
    document |= {"run": run_of_document(document)}
    write_result_files(folder, document, contents, "")


def page(folder):
    add_result_files(folder, {"report.html": b"new"})


def added(folder):
    add_result_files(folder, {"images/a.png": b"new", "a.obj": b"new"})


def export(folder):
    with atomic_write(folder) as write:
        for name in ("a.mtl", "images/a.png", "a.obj"):
            write(name).write_bytes(b"new")


def table(folder):
    write_own(folder / "table.csv", b"new", "")


def cache(folder):
    write_value(folder / "a.npz", (np.arange(3), "new"))


OF_RESULT = (result, page, added)
OPERATIONS = (*OF_RESULT, export, table, cache)


def files(folder):
    """Return the files of a folder without temporary ones."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(".")
    }


def is_untouched(folder):
    """Return whether a folder has files of a result alone, each as the document states it."""
    listed = json.loads((folder / "reconstruction.json").read_bytes())["files"]
    there = files(folder).keys() - {"reconstruction.json"}
    return all(file_digest(folder / name) == listed[name] for name in there)


@pytest.fixture
def before(tmp_path):
    """A folder with the folder of a result, which has a page."""
    result(tmp_path / "before" / "result", OLD)
    add_result_files(tmp_path / "before" / "result", {"report.html": b"old"})
    return tmp_path / "before"


@pytest.mark.parametrize("how", HOWS)
@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda operation: operation.__name__)
def test_an_interruption_loses_nothing_and_is_no_success(operation, how, before, tmp_path):
    place = tmp_path / "place"
    folder = place / "result"
    if operation is export:
        (before / "result" / "a.obj").write_bytes(b"old")
    old = files(before / "result")

    def run(number):
        shutil.copytree(before, place)
        steps = Steps(place, number, how)
        is_done = False
        with steps.applied(), suppress(OutputError, OSError, KeyboardInterrupt):
            operation(folder)
            is_done = True
        return steps.count, is_done

    count, _ = run(None)
    new = files(folder)
    for number in range(count):
        shutil.rmtree(place)
        _, is_done = run(number)
        if operation is result and not folder.exists():
            assert how in ("killed", "EROFS")
            assert files(place / HIDDEN) == old
        elif is_done or operation is result:
            assert files(folder) in ([new] if is_done else [old, new])
        elif operation in OF_RESULT:
            assert is_untouched(folder)
            assert {*files(folder).items()} <= {*old.items(), *new.items(), document_of(folder)}
        operation(folder)
        assert files(folder) == new
        if operation is not cache:  # whose parts go after an hour
            assert not any(map(is_part, os.listdir(folder)))
        if operation in OF_RESULT:
            result(folder)
            assert files(folder).keys() == {*NEW, "reconstruction.json"}
            assert [path.name for path in place.iterdir()] == ["result"]


def document_of(folder):
    return "reconstruction.json", (folder / "reconstruction.json").read_bytes()


def test_the_hidden_result_of_a_killed_process_is_as_safe_as_any(tmp_path):
    folder = tmp_path / "result"
    one, other = (replace(tiny_result(), photo=f"sha256:{number}") for number in (1, 2))
    save_reconstruction(one, folder, "numbers")
    folder.rename(tmp_path / HIDDEN)
    for made in (False, True):
        if made:
            folder.mkdir()
        with pytest.raises(OutputError, match="another photo"):
            save_reconstruction(other, folder, "numbers")
        assert load_reconstruction(folder).photo == "sha256:1"
        folder.rename(tmp_path / HIDDEN)
    folder.mkdir()
    (folder / "mine").write_text("mine")
    with pytest.raises(OutputError):
        save_reconstruction(other, folder, "numbers", overwrite=True)
    assert load_reconstruction(tmp_path / HIDDEN).photo == "sha256:1"
    assert (folder / "mine").read_text() == "mine"


@pytest.mark.skipif(sys.platform == "win32", reason="folders have no locks")
@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda operation: operation.__name__)
def test_two_writers_without_a_common_lock_end_with_one_result_or_an_error(
    operation, before, tmp_path, monkeypatch
):
    """As on a network folder that two machines write to."""
    monkeypatch.setattr("fcntl.flock", lambda file, kind: None)
    folder = tmp_path / "place" / "result"
    other = {name: content + b" of another" for name, content in OLD.items()}

    def attempt(write, *arguments):
        with suppress(OutputError):
            write(folder, *arguments)
            done.append(write)

    number = 0
    while True:
        done = []
        shutil.copytree(before, folder.parent)
        steps = Steps(folder.parent, number, lambda: attempt(result, other))
        with steps.applied():
            attempt(operation)
        if number >= steps.count:
            break
        if operation is result:
            assert len(done) < 2 or is_untouched(folder)
        shutil.rmtree(folder.parent)
        number += 1


@pytest.mark.parametrize("how", ["killed", "full"])
def test_a_row_of_the_journal_is_there_or_not(how, tmp_path):
    rows = [{"id": name, "state": "done", "config": "1", "finished": name} for name in "abc"]
    folder = tmp_path / "batch"

    def append(row):
        with Journal(folder / "journal.jsonl") as journal:
            journal.append(row)

    def run(number):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        append(rows[0])
        steps = Steps(folder, number, how)
        with steps.applied(), suppress(OutputError):
            append(rows[1])
        return steps.count

    for number in range(run(None)):
        run(number)
        found = read_journals(folder, rows[0])
        assert found in ({"a": rows[0]}, {"a": rows[0], "b": rows[1]})
        append(rows[2])
        assert read_journals(folder, rows[0]) == {**found, "c": rows[2]}


def test_temporary_files_of_a_user_stay(tmp_path):
    mine = {".mine.part", ".x.deadbeef.part", ".mine.physic-part", "a.0123abcd.physic-part"}
    for name in mine:
        (tmp_path / name).write_text("mine")
    (tmp_path / ".a.0123abcd.physic-part").write_text("left behind")
    with atomic_write(tmp_path) as temporary:
        temporary("a").write_text("a")
    assert {*os.listdir(tmp_path)} == {"a", *mine}
