"""What a run imports in second threads, beside its networks and beside the files of its result."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROBE = """
import sys
import threading

beside = set()
running = threading.Event()


class Recorder:
    def find_spec(self, name, path=None, target=None):
        if threading.current_thread() is not threading.main_thread():
            beside.add(name.partition(".")[0])
            if name == "torch" and not running.wait(60):
                beside.add("nothing runs beside torch")


def begin(stage, *_):
    if stage == "keypoints":
        running.set()


sys.meta_path.insert(0, Recorder())
from physic_core import Pipeline, Reconstruction
from physic_testing.worlds import load_world

with Pipeline({"extends": "mock"}) as pipeline:
    pipeline(load_world("stand", (96, 72)).image, progress=begin).save(sys.argv[1], "numbers")
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
def test_torch_alone_is_imported_beside_the_networks(tmp_path):
    for probe, folders in ((PROBE, ["numbers"]), (AGAIN, ["numbers", "pictures"])):
        done = subprocess.run(
            [sys.executable, "-c", probe, *(str(tmp_path / name) for name in folders)],
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        assert not {"scipy", "nothing"} & set(done.stdout.split())
    assert (tmp_path / "pictures" / "preview.png").exists()
