"""Checks of a plugin as it is installed, and the command line."""

from __future__ import annotations

import re

import pytest

from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks

DEPTH = """
import numpy as np
from physic_core.errors import InputError
from physic_core.interfaces import MetricDepth
from physic_core.types import DepthMap

class B(MetricDepth):
    \"\"\"Everything is {metres} m away.\"\"\"

    written_for = 1

    def infer(self, image, hints):
        return DepthMap(np.full(image.shape[:2], {metres}, np.float32))
"""


HOOKS = """
from physic_core import PluginItem, hookimpl

@hookimpl
def physic_commands():
    return []
"""


@pytest.fixture
def offer(site):
    """Install a depth plugin whose module of hooks imports something first."""

    def install(distribution, metres, first=""):
        name = distribution.removeprefix("physic-")
        module = f"{distribution.replace('-', '_')}_backend"
        (site.folder / f"{module}.py").write_text(DEPTH.format(metres=metres))
        hooks = f"[physic.plugins]\n{name} = {distribution.replace('-', '_')}\n"
        entry = f"{hooks}[physic.metric_depth]\n{name} = {module}:B\n"
        site.install(distribution, f"{first}\n{HOOKS}", entry=entry)

    return install


@pytest.mark.parametrize(
    ("first", "outcome", "got"),
    [
        ("", "passed", ""),
        ("import torch", "failed", "torch"),
        (
            "import time\nend = time.process_time() + 0.8\nwhile time.process_time() < end: pass",
            "failed",
            "nothing heavy, in ",
        ),
    ],
)
def test_a_module_of_hooks_that_imports_or_computes_much_is_caught(offer, first, outcome, got):
    offer("physic-flat", 3.0, first)
    result = start_checks(find_backend("flat", "metric_depth")).result("registration_is_light")
    assert result.outcome == outcome
    assert got in result.got


def test_check_prints_failures_and_counts_and_ends_with_5_if_there_are_any(offer, physic):
    offer("physic-flat", 3.0)
    done = physic("plugins", "check", "flat")
    assert done.exit_code == 0, done.output
    summary = r"^metric_depth:flat  \d+ checks: \d+ passed, 1 warned of, \d+ skipped"
    assert re.search(summary, done.stdout, re.MULTILINE)
    offer("physic-far", 300.0)
    done = physic("plugins", "check", "far", "--interface", "metric_depth")
    assert done.exit_code == 5, done.output
    assert "  hint:     Is it centimeters, " in done.stdout


def test_check_says_what_is_wrong_with_its_arguments(offer, physic):
    offer("physic-flat", 3.0)
    assert "Did you mean 'flat'?" in physic("plugins", "check", "flatt").stderr
    assert (
        "--option gain: write KEY=VALUE"
        in physic("plugins", "check", "flat", "--option", "gain").stderr
    )
    done = physic("plugins", "check", "flat", "--option", "gain=2")
    assert done.exit_code == 2
    assert "Error: metric_depth 'flat': gain: unknown option\n" in done.stderr
