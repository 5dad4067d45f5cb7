"""Plugins that import onnxruntime by themselves, as strangers write them: whoever imports such a
plugin, the home folder of the user stays empty.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from importlib.util import find_spec

import httpx2
import pytest
from PIL import Image

from physic_testing import load_world

PLUGIN = """
import onnxruntime
from physic_mock import backends


class Depth(backends.MockMetricDepth):
    \"\"\"A stranger's depth, which runs a network of its own.\"\"\"
"""
CHOICE = ("--preset", "mock", "--set", "metric_depth.backend=stranger:Depth")
SLOW = pytest.mark.slow
QUICK = ("--set", "engine.joint.optimiser.steps=1", "--set", "run.cache=false")
LOADED = (
    "from physic_core import load_backend; load_backend('metric_depth', '{folder}/stranger:Depth')"
)
BATCH = ("batch", "walk.png", *CHOICE, *QUICK, "--workers", "1")
NEEDS_RAY = pytest.mark.skipif(find_spec("ray") is None, reason="needs Ray")
COMMANDS = [
    pytest.param(("run", "walk.png", "-o", "result", *CHOICE, *QUICK), id="run", marks=SLOW),
    pytest.param((*BATCH, "-o", "results"), id="a worker of a batch"),
    pytest.param((*BATCH, "-o", "ray", "--executor", "ray"), id="Ray", marks=[SLOW, NEEDS_RAY]),
    pytest.param(("plugins", "check", "stranger:Depth", "--json"), id="the kit", marks=SLOW),
    pytest.param(("config", "check", *CHOICE), id="the check of a config"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the plugin and a photo."""
    made = tmp_path_factory.mktemp("stranger")
    (made / "stranger.py").write_text(PLUGIN)
    Image.fromarray(load_world("walk", (160, 120)).image).save(made / "walk.png")
    return made


@pytest.fixture
def home(tmp_path):
    """A new home folder, and the environment of a user who has it."""
    hidden = ("CI", "ORT_", "XDG_", "HF_", "DO_NOT_TRACK", "RAY_", "PHYSIC_", "TF_BUILD")
    kept = {name: text for name, text in os.environ.items() if not name.startswith(hidden)}
    return tmp_path, kept | {"HOME": str(tmp_path), "PHYSIC_CACHE": "off"}


def started(folder, environment, *command):
    return subprocess.Popen(
        [sys.executable, "-P", *command],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def files_in(home):
    return sorted(str(path.relative_to(home)) for path in home.rglob("*") if path.is_file())


def finished(process):
    printed, errors = process.communicate(timeout=300)
    assert process.returncode == 0, printed + errors


@pytest.fixture(autouse=True, scope="module")
def _onnxruntime_keeps_data(folder, tmp_path_factory):
    home = tmp_path_factory.mktemp("home")
    plain = {name: os.environ[name] for name in ("PATH", "LD_LIBRARY_PATH") if name in os.environ}
    finished(started(folder, plain | {"HOME": str(home)}, "-c", "import onnxruntime"))
    if not files_in(home):
        pytest.skip("this onnxruntime keeps no data in the home folder")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_with_a_strangers_network_leaves_home_empty(command, folder, home):
    place, environment = home
    finished(started(folder, environment, "-m", "physic_core", *command))
    assert files_in(place) == []


def test_a_script_with_a_strangers_network_leaves_home_empty(folder, home):
    place, environment = home
    finished(started(folder, environment, "-c", LOADED.format(folder=folder)))
    assert files_in(place) == []


@pytest.mark.slow
def test_a_server_with_a_strangers_network_leaves_home_empty(folder, home):
    place, environment = home
    command = ("-m", "physic_core", "serve", *CHOICE, *QUICK, "--port", "0")
    with started(folder, environment, *command) as server:
        line = server.stdout.readline()
        found = re.match(r"http://127\.0\.0\.1:\d+", line)
        assert found, line + server.communicate()[1]
        photo = {"photo": ("walk.png", (folder / "walk.png").read_bytes())}
        page = httpx2.post(f"{found[0]}/jobs", files=photo).headers["location"]
        until = time.monotonic() + 120
        while "Done" not in (text := httpx2.get(found[0] + page).text):
            assert "failed" not in text
            assert time.monotonic() < until
            time.sleep(0.1)
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=60)
    assert files_in(place) == []
