"""Commands run in a folder of their own, and change the search path of modules for themselves
alone.
"""

from __future__ import annotations

import sys

import pytest

from .results import empty_reconstruction


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))


class Pipeline:
    """Stands in for the real one, and remembers what it was asked.

    Attributes:
        result: function from the path of a photo to its result.
        error: raised in place of a result.
        calls: path and config of each call.
    """

    def __init__(self):
        self.result = lambda path: empty_reconstruction()
        self.error = None
        self.calls = []

    def reconstruct(self, path, plan, *, progress):
        self.calls.append((path, plan.config))
        progress = progress or (lambda *_: None)
        progress("people", 0, 2)
        if self.error is not None:
            raise self.error
        progress("scene", 1, 2)
        return self.result(path)


@pytest.fixture
def pipeline(monkeypatch):
    stand_in = Pipeline()
    monkeypatch.setattr("physic_core.pipeline.run.reconstruct", stand_in.reconstruct)
    return stand_in
