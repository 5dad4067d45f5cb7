"""Writers of one folder wait for each other, also where folders have no locks nothing is lost."""

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

from physic_core.files.atomic import atomic_write

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="folders have no locks")


def test_writers_wait_for_each_other(tmp_path: Path):
    inside, most = 0, 0

    def write() -> None:
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


def _hold(folder: str, ready: Any) -> None:
    with atomic_write(Path(folder)) as temporary:
        temporary("a").write_text("a")
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
    assert len(list(tmp_path.iterdir())) == 1
    with atomic_write(tmp_path) as temporary:
        temporary("b").write_text("b")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_where_nothing_can_be_locked_writes_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As on a network file system whose server has no lock service."""

    def refuse(file: int, kind: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", refuse)
    (tmp_path / ".b.0123abcd.physic-part").write_text("perhaps of another process")
    with atomic_write(tmp_path) as temporary:
        temporary("a").write_text("a")
    assert {path.name for path in tmp_path.iterdir()} == {"a", ".b.0123abcd.physic-part"}
