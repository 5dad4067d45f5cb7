"""Each kind of interruption at each step of a write, with small files: what was written before is
whole, or what is written now, or both can be completed; and an error is never taken for success.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import sys
from contextlib import suppress

import numpy as np
import pytest

from interrupted import Steps
from physic_core.errors import OutputError
from physic_core.files.atomic import atomic_write, write_own
from physic_core.files.plain import write_value
from physic_core.io.result_folder import (
    Replaceable,
    add_result_file,
    digest_of,
    file_digest,
    is_unfinished,
    record_exports,
    repair_result,
    write_result_files,
)

HOWS = ("killed", "interrupted", "ENOSPC", "EDQUOT", "ESTALE", "EROFS", "ENOENT")
OLD = {"reconstruction.npz": b"old", "people.csv": b"old", "preview.png": b"old", "a/b.txt": b"old"}
NEW = {"reconstruction.npz": b"new", "people.csv": b"new", "c/d.txt": b"new"}


def result(folder, contents=NEW):
    repair_result(folder)
    document = {"schema": "physic-reconstruction", "run": digest_of(contents["people.csv"])}
    write_result_files(folder, document, contents, Replaceable(""))


def page(folder):
    add_result_file(folder, "report.html", b"new")


def listing(folder):
    record_exports(folder, [folder / "a.obj"])


def export(folder):
    with atomic_write(folder) as write:
        for name in ("a.mtl", "images/a.png", "a.obj"):
            write(name).write_bytes(b"new")


def table(folder):
    write_own(folder / "table.csv", b"new", "")


def cache(folder):
    write_value(folder / "a.npz", (np.arange(3), "new"))


OPERATIONS = (result, page, listing, export, table, cache)


def files(folder):
    """Return the files of a folder without temporary ones."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(".")
    }


def is_whole(folder):
    """Return whether a folder has a result with all of its files."""
    listed = json.loads((folder / "reconstruction.json").read_bytes())["files"]
    return all(file_digest(folder / name) == digest for name, digest in listed.items())


@pytest.fixture
def before(tmp_path):
    """The folder of a result and of a file of the user."""
    folder = tmp_path / "before"
    result(folder, OLD)
    (folder / "a.obj").write_bytes(b"old")
    return folder


@pytest.mark.parametrize("how", HOWS)
@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda operation: operation.__name__)
def test_an_interruption_loses_nothing_and_is_no_success(operation, how, before, tmp_path):
    folder = tmp_path / "folder"
    if operation is result:
        (before / "people.csv").write_bytes(b"mine")
    old = files(before)

    def run(number):
        shutil.copytree(before, folder)
        steps = Steps(folder, number, how)
        is_done = False
        with steps.applied(), suppress(OutputError, OSError, KeyboardInterrupt):
            operation(folder)
            is_done = True
        return steps.count, is_done

    count, _ = run(None)
    new = files(folder)
    known = {*old.values(), *new.values()}
    for number in range(count):
        shutil.rmtree(folder)
        _, is_done = run(number)
        found = files(folder)
        if is_done:
            assert found == new
        elif operation is result:
            assert found in (old, new) or is_unfinished(folder)
        elif operation in (page, listing):
            assert is_whole(folder)
        assert known >= set(found.values()) >= known & {b"mine"}
        operation(folder)
        assert files(folder) == new


def test_renames_that_fail_for_good_leave_a_result_that_can_be_completed(before, tmp_path):
    """As on a disk that is full: files can still be deleted."""
    folder = tmp_path / "folder"
    old = files(before)
    real = os.replace
    for number in range(8):
        left = [number]

        def replace(*paths, left=left):
            left[0] -= 1
            if left[0] < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            real(*paths)

        shutil.copytree(before, folder)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "replace", replace)
            with suppress(OutputError):
                result(folder)
        assert files(folder) == old or is_unfinished(folder) or is_whole(folder)
        result(folder)
        assert is_whole(folder)
        shutil.rmtree(folder)


@pytest.mark.skipif(sys.platform == "win32", reason="folders have no locks")
@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda operation: operation.__name__)
def test_two_writers_without_a_common_lock_end_with_one_result_or_an_error(
    operation, before, tmp_path, monkeypatch
):
    """As on a network folder that two machines write to."""
    monkeypatch.setattr("fcntl.flock", lambda file, kind: None)
    folder = tmp_path / "folder"
    other = {name: content + b" of another" for name, content in OLD.items()}

    def attempt(write, *arguments):
        with suppress(OutputError):
            write(folder, *arguments)
            done.append(write)

    number = 0
    while True:
        done = []
        shutil.copytree(before, folder)
        steps = Steps(folder, number, lambda: attempt(result, other))
        with steps.applied():
            attempt(operation)
        if number >= steps.count:
            break
        assert len(done) < 2 or is_whole(folder)
        result(folder)
        assert is_whole(folder)
        shutil.rmtree(folder)
        number += 1
