"""Hashes of the user's files: read once, and never those of older content."""

from __future__ import annotations

import hashlib
import os

import pytest

from physic_core.cache.digests import remembered_sha256

pytestmark = pytest.mark.quick

LATER = """
import hashlib, sys, time
from pathlib import Path
now = time.time_ns()
time.time_ns = lambda: now + 10_000_000_000
from physic_core.cache.digests import remembered_sha256
if sys.argv[2] == "known":
    hashlib.file_digest = None
print(remembered_sha256(Path(sys.argv[1])))
"""


def write_again(path, content):
    """Write a file of the same size in place, with the same time of its last change."""
    before = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (path.stat().st_size, path.stat().st_ino) == (before.st_size, before.st_ino)


@pytest.mark.parametrize("kept", [True, False])
def test_other_content_of_the_same_size_and_time_has_another_hash(
    root, tmp_path, monkeypatch, kept
):
    if not kept:
        monkeypatch.setenv("PHYSIC_CACHE", "off")
    path = tmp_path / "weights"
    path.write_bytes(b"one")
    for content in (b"one", b"two", b"six"):
        write_again(path, content)
        assert remembered_sha256(path) == hashlib.sha256(content).hexdigest()


def test_two_changes_within_a_step_of_the_clock_are_both_noticed(root, tmp_path, monkeypatch):
    path = tmp_path / "weights"
    path.write_bytes(b"one")
    status = path.stat()
    monkeypatch.setattr(os, "fstat", lambda file: status)
    for content in (b"one", b"two"):
        path.write_bytes(content)
        assert remembered_sha256(path) == hashlib.sha256(content).hexdigest()


def test_a_file_is_read_by_one_process_for_all(root, tmp_path, python):
    def later(path, word):
        """Hash a file in another process, some seconds later."""
        return python(LATER, path, word).stdout.strip()

    path = tmp_path / "weights"
    path.write_bytes(b"one")
    digest = hashlib.sha256(b"one").hexdigest()
    assert later(path, "new") == later(path, "known") == digest
    (kept,) = (root / "hashes").iterdir()
    assert os.name != "posix" or kept.stat().st_mode & 0o777 == 0o600
    kept.write_text("damaged")
    assert later(path, "new") == digest == kept.read_text()
