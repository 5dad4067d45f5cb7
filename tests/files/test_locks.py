"""Locks of folders, and what happens where folders cannot be locked."""

from __future__ import annotations

import errno
import multiprocessing
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from filelock import Timeout

import physic_core.files.atomic as atomic
import physic_core.files.locks as locks
from physic_core.errors import OutputError
from physic_core.files.atomic import atomic_write
from physic_core.files.locks import LOCK_FILE, lock_folder


@pytest.fixture(params=["folder", "file"])
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Lock the folder itself, or a file in it, as where folders cannot be locked."""

    def refuse(file: int, *, blocking: bool) -> bool:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))

    if request.param == "file":
        monkeypatch.setattr(locks, "lock_descriptor", refuse)
    return str(request.param)


def test_a_lock_excludes_others(kind: str, tmp_path: Path):
    with lock_folder(tmp_path, 0), pytest.raises(Timeout), lock_folder(tmp_path, 0.02):
        pass
    with lock_folder(tmp_path, 0):
        pass
    assert [path.name for path in tmp_path.iterdir()] == [LOCK_FILE] * (kind == "file")


def test_writers_wait_for_each_other(kind: str, tmp_path: Path):
    inside, most = 0, 0

    def write() -> None:
        nonlocal inside, most
        for _ in range(5):
            with lock_folder(tmp_path, 30):
                inside += 1
                most = max(most, inside)
                time.sleep(0.001)
                inside -= 1

    threads = [threading.Thread(target=write) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1


def _hold(folder: str, ready: Any) -> None:
    with lock_folder(Path(folder), 0):
        ready.set()
        time.sleep(60)


def test_a_lock_ends_with_its_process(tmp_path: Path):
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    process = context.Process(target=_hold, args=(str(tmp_path), ready))
    process.start()
    ready.wait(60)
    process.kill()
    process.join()
    with lock_folder(tmp_path, 5):
        pass


@pytest.mark.skipif(sys.platform == "win32", reason="Windows always has locks")
def test_where_nothing_can_be_locked_writes_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As on a network file system whose server has no lock service."""

    def refuse(file: int, kind: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", refuse)
    (tmp_path / ".b.0123abcd.physic-part").write_text("perhaps of another process")
    with atomic_write(tmp_path) as temporary:
        temporary("a").write_text("a")
    assert {path.name for path in tmp_path.iterdir()} == {"a", ".b.0123abcd.physic-part", LOCK_FILE}


def test_a_writer_that_never_ends_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(atomic, "_WAIT_S", 0.02)
    with lock_folder(tmp_path, 0), pytest.raises(OutputError) as error, atomic_write(tmp_path):
        pass
    assert str(error.value) == (
        f"cannot write to {tmp_path}: another process has been writing there for 0 s; "
        "wait for its end, or name another folder"
    )
