"""What a run imports in second threads, beside its networks and beside the files of its result."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROBE = """
import sys
import threading

beside = set()


class Recorder:
    def find_spec(self, name, path=None, target=None):
        if threading.current_thread() is not threading.main_thread():
            beside.add(name.partition(".")[0])


sys.meta_path.insert(0, Recorder())
from physic_core import Pipeline, Reconstruction
from physic_testing.worlds import load_world

with Pipeline({"extends": "mock"}) as pipeline:
    pipeline(load_world("stand", (96, 72)).image).save(sys.argv[1], "numbers")
for thread in threading.enumerate():
    if thread is not threading.main_thread():
        thread.join(60)
print(*sorted(beside))
"""


AGAIN = (
    PROBE.partition("with Pipeline")[0]
    + """
Reconstruction.load(sys.argv[1]).save(sys.argv[2])
print(*sorted(beside))
"""
)


@pytest.mark.slow
def test_packages_of_scipy_are_imported_in_one_thread(tmp_path):
    for probe, folders in ((PROBE, ["numbers"]), (AGAIN, ["numbers", "pictures"])):
        done = subprocess.run(
            [sys.executable, "-c", probe, *(str(tmp_path / name) for name in folders)],
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        assert "scipy" not in done.stdout.split()
    assert (tmp_path / "pictures" / "preview.png").exists()
