"""Commands run in a folder of their own, and change the search path of modules for themselves
alone.
"""

from __future__ import annotations

import sys

import pytest


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
