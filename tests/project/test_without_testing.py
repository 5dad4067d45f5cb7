"""physic-core and physic-embedded work where physic-testing is not installed."""

from __future__ import annotations

import os
import subprocess
import sys

RUN = """
import sys
sys.modules["physic_testing"] = None  # an import of it fails
from physic_core.cli import main
main(sys.argv[1:])
"""


def run(*arguments, plugins):
    environment = os.environ | {"PHYSIC_PLUGINS": plugins}
    command = [sys.executable, "-c", RUN, *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, env=environment, timeout=600, check=False
    )


def test_its_commands_are_not_there_and_the_others_are():
    assert run("plugins", plugins="physic-embedded").returncode == 0
    done = run("plugins", "check", plugins="physic-embedded")
    assert done.returncode == 2
    assert "physic-testing, which is not installed" in done.stderr


def test_without_a_restriction_it_is_a_broken_plugin_and_nothing_more():
    done = run("plugins", plugins="physic-embedded,physic-testing")
    assert done.returncode == 0, done.stderr
    (broken,) = (line for line in done.stdout.splitlines() if line.startswith("BROKEN"))
    assert "physic-testing" in broken
