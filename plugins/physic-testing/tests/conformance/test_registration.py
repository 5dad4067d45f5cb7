"""Checks of a plugin as it is installed, and the command line."""

from __future__ import annotations

import json
import re
from importlib import metadata
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from physic_core.cli import main
from physic_core.discovery.plugins import discover
from physic_core.discovery.registry import Registry
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks

TESTING = [entry for entry in metadata.entry_points(group="physic.plugins") if entry.value == "physic_testing"]
"""The plugin of the commands."""

DEPTH = """
import numpy as np
from physic_core.errors import InputError
from physic_core.interfaces import MetricDepth
from physic_core.types import DepthMap

class B(MetricDepth):
    \"\"\"Everything is {metres} m away.\"\"\"

    def infer(self, image, hints):
        return DepthMap(np.full(image.shape[:2], {metres}, np.float32))
"""


@pytest.fixture
def offer(site, monkeypatch: pytest.MonkeyPatch):
    """Install a depth plugin whose registration imports something; return the registry of everything installed."""

    def install(distribution: str, metres: float, first: str = "") -> Registry:
        module = site.offer(distribution, "metric_depth", distribution.removeprefix("physic-"))
        path = Path(site.folder) / f"{module}.py"
        path.write_text(f"{first}\n{path.read_text().replace(f'{module}:B', f'{module}_backend:B')}")
        (Path(site.folder) / f"{module}_backend.py").write_text(DEPTH.format(metres=metres))
        entries = [*TESTING, *site.entries()]
        monkeypatch.setattr(
            "physic_core.discovery.registration.entry_points", lambda group: [e for e in entries if e.group == group]
        )
        return discover()

    return install


def registration(registry: Registry, name: str):
    return start_checks(find_backend(name, "metric_depth", registry)).result("registration_is_light")


def physic(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


def test_a_light_registration_passes(offer):
    assert registration(offer("physic-flat", 3.0), "flat").outcome == "passed"


def test_torch_imported_at_registration_is_caught(offer):
    result = registration(offer("physic-flat", 3.0, "import torch"), "flat")
    assert result.outcome == "failed"
    assert "torch" in result.got


def test_a_registration_that_computes_is_caught(offer):
    busy = "import time\nend = time.process_time() + 0.8\nwhile time.process_time() < end:\n    pass"
    result = registration(offer("physic-busy", 3.0, busy), "busy")
    assert result.outcome == "failed"
    assert result.expected == "less than 0.5 s of processor time to list the plugin"


def test_check_prints_failures_and_counts_and_ends_with_5_if_there_are_any(offer):
    offer("physic-flat", 3.0)
    done = physic("plugins", "check", "flat")
    assert done.exit_code == 0, done.output
    assert re.match(r"metric_depth:flat  \d+ checks: \d+ passed, \d+ skipped", done.stdout.splitlines()[-2])
    offer("physic-far", 300.0)
    done = physic("plugins", "check", "far", "--interface", "metric_depth")
    assert done.exit_code == 5, done.output
    assert "  hint:     Is it centimetres?\n" in done.stdout


def test_check_says_what_is_wrong_with_its_arguments(offer):
    offer("physic-flat", 3.0)
    assert "Did you mean 'flat'?" in physic("plugins", "check", "flatt").stderr
    assert "--option gain: write KEY=VALUE" in physic("plugins", "check", "flat", "--option", "gain").stderr
    done = physic("plugins", "check", "flat", "--option", "gain=2")
    assert done.exit_code == 2
    assert "Error: metric_depth 'flat': gain: unknown option\n" in done.stderr


def test_compare_prints_a_table_and_json(offer):
    offer("physic-flat", 3.0)
    offer("physic-far", 300.0)
    done = physic("plugins", "compare", "metric_depth", "flat", "far", "--world", "stand")
    assert done.exit_code == 0, done.output
    head, flat, far, _ = done.stdout.splitlines()
    assert [line.split()[0] for line in (head, flat, far)] == ["backend", "flat", "far"]
    assert "1 of 1" in flat
    done = physic("plugins", "compare", "metric_depth", "flat", "far", "--world", "stand:0", "--json")
    read = json.loads(done.stdout)
    assert [b["backend"] for b in read["backends"]] == ["flat", "far"]
    assert read["worlds"] == [["stand", 0]]
