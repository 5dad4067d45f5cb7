"""A run constructs each backend once."""

from __future__ import annotations

from collections import Counter

import pytest
from PIL import Image

from physic_core.errors import NoPersonError
from physic_core.interfaces import INTERFACES, Backend
from physic_mock.backends import MockSegmenter
from physic_testing.worlds import load_world

pytestmark = pytest.mark.usefixtures("few_steps")

ONCE = Counter(dict.fromkeys(INTERFACES, 1))


@pytest.fixture
def constructed(monkeypatch):
    """How often a backend of each interface is constructed.

    Nobody is found, so that no run takes long.
    """
    counts = Counter()
    plain = Backend.__init__

    def count(self, options=None):
        counts[self.interface] += 1
        plain(self, options)

    def nobody(self, image):
        raise NoPersonError("nobody was found")

    monkeypatch.setattr(Backend, "__init__", count)
    monkeypatch.setattr(MockSegmenter, "infer", nobody)
    return counts


@pytest.fixture
def photo(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(load_world("stand", (160, 120)).image).save("photo.png")
    return "photo.png"


def test_a_run_of_the_command_line_constructs_each_backend_once(constructed, photo, physic):
    done = physic("run", photo, "--preset", "mock", "--no-cache")
    assert "nobody was found" in done.output
    assert constructed == ONCE
