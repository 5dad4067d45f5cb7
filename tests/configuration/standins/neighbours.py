"""What the tests of the plugins have and these need too: tiny networks, ONNX files, a made-up SMPL file."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

PLUGINS = Path(__file__).parents[3] / "plugins"


@cache
def neighbour(plugin: str, module: str) -> ModuleType:
    """A module of ``plugins/PLUGIN/tests``, imported under a name of its own."""
    name = f"standins_{plugin.replace('-', '_')}_{module}"
    spec = importlib.util.spec_from_file_location(name, PLUGINS / plugin / "tests" / f"{module}.py")
    found = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found
