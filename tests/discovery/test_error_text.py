"""Errors of plugins name the file and the line in which they arose, in every command and in
pytest.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from physic_core.discovery.error_text import describe_error

pytestmark = pytest.mark.usefixtures("few_steps")

BROKEN = """\
import numpy as np
from physic_core import PluginItem, hookimpl
from physic_core.interfaces import Inpainter
from physic_core.types import Intrinsics

class Fill(Inpainter):
    written_for = 1
    def infer(self, image, mask):
        return self.options.nothere

class Camera(Inpainter):
    def infer(self, image, mask):
        return helper(image)

def helper(image):
    return np.linalg.inv(np.zeros((2, 3)))

@hookimpl
def physic_commands():
    return [PluginItem("raises", "physic_broken:command")]
"""
ENTRIES = """\
[physic.inpainter]
raises = physic_broken:Fill
[physic.plugins]
broken = physic_broken
"""
SAID = "AttributeError: 'Options' object has no attribute 'nothere' (physic_broken.py:9)"


@pytest.fixture
def broken(site, monkeypatch):
    site.install("physic-broken", BROKEN, entry=ENTRIES)
    monkeypatch.setenv("PYTHONPATH", str(site.folder))
    folder = site.folder
    return folder


@pytest.fixture(params=[False, True], ids=["", "PHYSIC_DEBUG=1"])
def debug(request, monkeypatch):
    monkeypatch.setenv("PHYSIC_DEBUG", "1" if request.param else "0")
    return bool(request.param)


def caught(call, *arguments):
    try:
        call(*arguments)
    except BaseException as error:
        return error
    raise AssertionError("it raised nothing")


# ---- the place
# --------------------------------------------------------------------------------------------------


def test_the_place_is_the_innermost_line_of_the_plugins_own_code(broken):
    import physic_broken

    image = np.zeros((4, 4, 3), np.uint8)
    error = caught(physic_broken.Camera().infer, image, None)
    assert describe_error(error, physic_broken.Camera).endswith(" (physic_broken.py:16)")
    assert describe_error(error, "physic_broken").endswith(" (physic_broken.py:16)")
    # Without an owner it is the innermost line of all, here one of NumPy's.
    assert describe_error(error, "physic_other").rpartition("(")[2].startswith("numpy/linalg/")


def test_only_lines_that_locate_an_error_of_the_plugin_are_named(broken):
    (broken / "physic_typo.py").write_text("x = (\n")
    here = f"test_error_text.py:{caught.__code__.co_firstlineno + 2})"
    assert describe_error(caught(__import__, "physic_gone"), "physic_gone").endswith(here)
    # Python writes the place of a syntax error itself.
    assert describe_error(caught(__import__, "physic_typo"), "physic_typo").endswith(
        "(physic_typo.py, line 1)"
    )
    assert describe_error(RuntimeError(), "physic_typo") == "RuntimeError"


# ---- in every command
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("debug", [True], indirect=True)
def test_a_run_names_the_line_and_shows_the_traceback_on_demand(broken, debug, tmp_path):
    from PIL import Image

    from physic_testing import load_world

    Image.fromarray(load_world("stand", (160, 120)).image).save(tmp_path / "photo.png")
    arguments = [
        "photo.png",
        "--preset",
        "mock",
        "--set",
        "inpainter.backend=raises",
        "-o",
        "out",
        "--no-cache",
    ]
    done = subprocess.run(
        [sys.executable, "-c", "from physic_core.cli import main; main()", "run", *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode != 0
    assert f"stage 'inpainting': {SAID}\n" in done.stderr
    assert ("return self.options.nothere" in done.stderr) is debug


def test_a_message_without_end_is_cut_and_one_that_fails_is_named():
    class Mute(Exception):
        def __str__(self):
            raise ValueError

    assert len(describe_error(ValueError("x" * 1_000_000))) < 5000
    assert describe_error(Mute()).startswith("Mute: ")
