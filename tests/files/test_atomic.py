"""Writers of one folder wait for each other, and replace only files with the mark of PhySIC, never
through a link.
"""

from __future__ import annotations

import errno
import multiprocessing
import os
import sys
import threading
import time
from pathlib import Path

import pytest

from physic_core.errors import OutputError
from physic_core.files.atomic import (
    LOCK_WAIT_S,
    MARK,
    atomic_write,
    check_own,
    open_to_append,
    read_regular,
)
from physic_core.files.serialization import read_value, write_value

pytestmark = [
    pytest.mark.quick,
    pytest.mark.skipif(sys.platform == "win32", reason="folders have no locks"),
]


def test_writers_wait_for_each_other(tmp_path):
    inside = 0
    most = 0

    def write():
        nonlocal inside, most
        for _ in range(5):
            with atomic_write(tmp_path) as temporary:
                inside += 1
                most = max(most, inside)
                time.sleep(0.001)
                temporary("a").write_text("a")
                inside -= 1

    threads = [threading.Thread(target=write) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def _hold(folder, ready):
    with atomic_write(Path(folder)) as temporary:
        temporary("a").write_text("a")
        ready.set()
        time.sleep(60)


def test_a_lock_ends_with_its_process(tmp_path):
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    process = context.Process(target=_hold, args=(str(tmp_path), ready))
    process.start()
    ready.wait(60)
    process.kill()
    process.join()
    assert len(list(tmp_path.iterdir())) == 1
    with atomic_write(tmp_path) as temporary:
        temporary("b").write_text("b")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_where_nothing_can_be_locked_writes_go_on(tmp_path, monkeypatch):
    """As on a network file system whose server has no lock service."""

    def refuse(file, kind):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", refuse)
    (tmp_path / ".b.0123abcd.physic-part").write_text("perhaps of another process")
    with atomic_write(tmp_path) as temporary:
        temporary("a").write_text("a")
    assert {path.name for path in tmp_path.iterdir()} == {"a", ".b.0123abcd.physic-part"}


@pytest.fixture
def passed(monkeypatch):
    """A function that returns the seconds that have passed: they pass in sleep alone."""
    slept = []
    monkeypatch.setattr(time, "sleep", slept.append)
    monkeypatch.setattr(time, "monotonic", lambda: sum(slept))
    return time.monotonic


@pytest.fixture
def locked_folder(tmp_path):
    """A folder that a process has locked, which is stopped and never ends its write."""
    import fcntl

    file = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(file, fcntl.LOCK_EX)
    yield tmp_path
    os.close(file)


def test_a_write_says_for_whom_it_waits_and_ends(locked_folder, passed, caplog):
    locks = Path("/proc/locks")
    is_known = locks.exists() and "FLOCK" in locks.read_text()
    who = f"process {os.getpid()} of this machine" if is_known else "another process"
    with pytest.raises(OutputError, match=who), atomic_write(locked_folder) as temporary:
        temporary("a").write_text("a")
    assert passed() == pytest.approx(LOCK_WAIT_S, abs=1)
    assert [who in record.getMessage() for record in caplog.records] == [True]


def test_a_cache_waits_for_nobody(locked_folder, passed):
    write_value(locked_folder / "a.npz", "a text")
    assert read_value(locked_folder / "a.npz", [str]) == "a text"
    assert passed() == 0


def test_a_file_that_is_larger_than_its_limit_is_refused(tmp_path):
    (tmp_path / "a").write_bytes(b"1234")
    assert read_regular(tmp_path / "a", 4) == b"1234"
    with pytest.raises(OSError, match="4 bytes, more than 3"):
        read_regular(tmp_path / "a", 3)


LONG = "x" * 1_000_000


@pytest.mark.parametrize("text", [f"{MARK}{LONG}", MARK])
def test_a_file_with_the_mark_at_its_start_may_be_replaced(tmp_path, text):
    (tmp_path / "table.txt").write_text(text)
    check_own(tmp_path / "table.txt", tmp_path / "missing.txt")


@pytest.mark.parametrize(
    "make",
    [
        lambda path: path.write_text("mine"),
        lambda path: path.touch(),
        lambda path: path.write_text(f"{LONG}{MARK}{LONG}"),
        lambda path: path.mkdir(),
        lambda path: path.symlink_to("missing"),
        lambda path: path.symlink_to("own"),
    ],
    ids=["text", "empty", "middle", "folder", "link to nothing", "link to an own file"],
)
def test_a_file_without_the_mark_at_an_end_belongs_to_the_user(tmp_path, make):
    (tmp_path / "own").write_text(MARK)
    make(path := tmp_path / "table.txt")
    with pytest.raises(OutputError, match=f"cannot write {path}: a file that PhySIC did not write"):
        check_own(tmp_path / "own", path)


def test_a_file_is_appended_to_and_a_link_is_not(tmp_path):
    for text in (b"a", b"b"):
        with open_to_append(tmp_path / "log") as file:
            file.write(text)
    (tmp_path / "link").symlink_to("log")
    with pytest.raises(OSError, match="it is a link"):
        open_to_append(tmp_path / "link")
    assert (tmp_path / "log").read_bytes() == b"ab"
