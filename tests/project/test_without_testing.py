"""metricbody and metricbody-embedded work where metricbody-testing is not installed."""

from __future__ import annotations

RUN = """
import sys
sys.modules["physic_testing"] = None  # an import of it fails
from physic_core.cli import main
main(sys.argv[1:])
"""


def test_its_commands_are_not_there_and_the_others_are(python):
    python(RUN, "plugins", PHYSIC_PLUGINS="metricbody-embedded")
    done = python(RUN, "plugins", "check", ends=2, PHYSIC_PLUGINS="metricbody-embedded")
    assert "metricbody-testing, which is not installed" in done.stderr


def test_without_a_restriction_it_is_a_broken_plugin_and_nothing_more(python):
    shown = python(RUN, "plugins", PHYSIC_PLUGINS="metricbody-embedded,metricbody-testing").stdout
    (broken,) = (line for line in shown.splitlines() if line.startswith("BROKEN"))
    assert "metricbody-testing" in broken
