"""``physic run`` as a whole, with the mock backends: odd photos give results, bad ones a message
and nothing else.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from physic_core import Reconstruction
from physic_core.cli import main
from physic_core.interfaces import INTERFACES, Backend
from physic_testing.worlds import load_world

pytestmark = pytest.mark.usefixtures("few_steps")


@pytest.fixture(scope="module")
def world():
    return load_world("stand", (160, 120))


def run(photo, *arguments):
    return CliRunner().invoke(main, ["run", photo, "--preset", "mock", "-o", "new/out", *arguments])


def test_a_principal_point_outside_the_photo_is_refused_and_one_off_centre_warns(world):
    Image.fromarray(world.image).save("a.png")
    done = run("a.png", "--intrinsics", "178,178,5000,5000")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "a.png: the principal point (5000, 5000) lies outside" in done.stderr
    done = run("a.png", "--intrinsics", "178,178,109.5,59.5")
    assert done.exit_code == 0, done.output
    assert "the principal point (110, 60) is 19% of" in done.stdout


ARRAYS = ["reconstruction.json", "reconstruction.npz"]
DEFAULT_FILES = ["combined.glb", "people.csv", "preview.png", *ARRAYS, "report.html"]


def written_by(*arguments):
    """The files that a run writes, which its document lists: name -> content."""
    done = run("a.png", *arguments)
    assert done.exit_code == 0, done.output
    files = {path.name: path.read_bytes() for path in Path("new/out").iterdir()}
    assert files.keys() == {
        "reconstruction.json",
        *json.loads(files["reconstruction.json"])["files"],
    }
    return files


@pytest.fixture
def constructed(monkeypatch):
    """The interface of each backend that is constructed."""
    interfaces = []
    plain = Backend.__init__

    def construct(self, options=None):
        interfaces.append(self.interface)
        plain(self, options)

    monkeypatch.setattr(Backend, "__init__", construct)
    return interfaces


@pytest.mark.parametrize(
    "part",
    [
        "physic_core.judge.run_checks",
        "physic_core.pipeline.reconstruction.with_checks_and_trust",
        "physic_core.pipeline.reconstruction.describe_repositories",
        "physic_core.pipeline.plausibility.disagreement_with_other_backends",
        "physic_core.io.results.person_rows",
        "physic_core.io.result_folder.person_rows",
        "physic_core.io.results.make_pictures",
    ],
)
def test_what_fails_beyond_the_answer_is_a_warning_of_the_saved_result(world, part, monkeypatch):
    monkeypatch.setattr(part, lambda *_: 1 / 0)
    Image.fromarray(world.image).save("a.png")
    done = run("a.png")
    assert done.exit_code == 0, done.output
    result = Reconstruction.load("new/out")
    assert len(result.people) == 1
    assert sum("failed: ZeroDivisionError" in text for text in result.warnings) == 1
    assert "failed: ZeroDivisionError" in done.output


def test_a_run_constructs_each_backend_once_and_writes_every_file_and_the_same_bytes_again(
    world, constructed
):
    Image.fromarray(world.image).save("a.png")
    written = [written_by("--intrinsics", "178,179,80,59") for _ in range(2)]
    assert sorted(constructed) == sorted([*INTERFACES] * 2)
    assert [sorted(files) for files in written] == [DEFAULT_FILES] * 2
    for name in ("combined.glb", "people.csv"):
        assert written[0][name] == written[1][name], name
    one, other = (np.load(BytesIO(files["reconstruction.npz"])) for files in written)
    for name in set(one) - {"run"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    camera = json.loads(written[0]["reconstruction.json"])["intrinsics"]
    numbers = {"fx": 178, "fy": 179, "cx": 80, "cy": 59, "width": 160, "height": 120}
    assert camera == numbers | {"source": "given", "trust": "known", "focal_sigma": None}


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX's")
def test_a_run_that_is_broken_off_leaves_nothing(world):
    Image.fromarray(world.image).save("a.png")
    Path("sleeper.py").write_text(
        "import pathlib, time\n"
        "from physic_core.interfaces import Segmenter\n"
        "class Sleeper(Segmenter):\n"
        "    def infer(self, image):\n"
        "        pathlib.Path('asleep').touch()\n"
        # A signal that comes just before a long sleep starts is handled only after it.
        "        for _ in range(6000):\n"
        "            time.sleep(0.1)\n"
    )
    handle = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    start = f"{handle}; from physic_core.cli import main; main()"
    command = [sys.executable, "-c", start, "run", "a.png", "--preset", "mock"]
    command += ["--set", "segmenter.backend=sleeper:Sleeper", "-o", "new/out"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            while not Path("asleep").exists():
                assert process.poll() is None, process.communicate()
                time.sleep(0.02)
            assert Path("new").is_dir()
            process.send_signal(signal.SIGINT)
            said = process.communicate(timeout=60)[1].decode()
        finally:
            process.kill()
    assert process.returncode == 130
    assert "cache" in said.splitlines()[-1]
    assert {path.name for path in Path().iterdir()} - {"__pycache__"} == {
        "a.png",
        "asleep",
        "sleeper.py",
    }
