"""The folder of a server, and folders of servers that were killed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from physic_serve.folder import server_folder

HOLD = """
import os, sys, signal
from pathlib import Path
from physic_serve.folder import server_folder
with server_folder(Path(sys.argv[1])) as place:
    (place / "photo").write_text("of a visitor")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_it_is_deleted_at_the_end(tmp_path: Path):
    with server_folder(tmp_path) as place:
        (place / "photo").write_text("of a visitor")
    assert list(tmp_path.iterdir()) == []


def test_that_of_a_killed_server_is_deleted_and_that_of_a_running_one_is_not(tmp_path: Path):
    with server_folder(tmp_path) as running:
        subprocess.run([sys.executable, "-P", "-c", HOLD, str(tmp_path)], check=False)
        assert len(list(tmp_path.rglob("photo"))) == 1
        with server_folder(tmp_path):
            assert list(tmp_path.rglob("photo")) == []
            assert running.is_dir()


def test_folders_of_others_are_left(tmp_path: Path):
    (tmp_path / "physic-serve-mine").mkdir()
    (tmp_path / "physic-serve-mine" / "notes").write_text("mine")
    with server_folder(tmp_path):
        pass
    assert [path.name for path in tmp_path.rglob("*")] == ["physic-serve-mine", "notes"]
