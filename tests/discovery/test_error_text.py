"""Errors of plugins name the file and the line in which they arose."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.discovery.error_text import describe_error

BROKEN = """\
import numpy as np
from physic_core.interfaces import Inpainter

class Camera(Inpainter):
    def infer(self, image, mask):
        return helper(image)

def helper(image):
    return np.linalg.inv(np.zeros((2, 3)))
"""


@pytest.fixture
def broken(site):
    site.install("physic-broken", BROKEN)
    return site.folder


def caught(call, *arguments):
    try:
        call(*arguments)
    except BaseException as error:
        return error
    raise AssertionError("it raised nothing")


def test_the_place_is_the_innermost_line_of_the_plugins_own_code(broken):
    import physic_broken

    image = np.zeros((4, 4, 3), np.uint8)
    error = caught(physic_broken.Camera().infer, image, None)
    assert describe_error(error, physic_broken.Camera).endswith(" (physic_broken.py:9)")
    assert describe_error(error, "physic_broken").endswith(" (physic_broken.py:9)")
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


def test_a_message_without_end_is_cut_and_one_that_fails_is_named():
    class Mute(Exception):
        def __str__(self):
            raise ValueError

    assert len(describe_error(ValueError("x" * 1_000_000))) < 5000
    assert describe_error(Mute()).startswith("Mute: ")
