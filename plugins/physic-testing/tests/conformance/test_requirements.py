"""What a backend needs is stated: its default weights in a manifest, its packages in the
requirements.
"""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import Field

from physic_mock.backends import MockMetricDepth
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks
from physic_testing.conformance.report import Result

MANIFEST = """
[free]
summary = "a network"
license = "Apache-2.0"
commercial = true
files = [{path = "b.onnx", source = "https://example.org/b.onnx"}]
"""
WEIGHTS = "default_weights_are_listed"
PACKAGES = "packages_are_required"


def result(check: str) -> Result:
    return start_checks(find_backend("own", "metric_depth")).result(check)


@pytest.mark.parametrize(
    ("default", "outcome"), [("free", "passed"), ("fre", "failed"), ("", "skipped")]
)
def test_the_default_weights_are_a_set_that_the_plugin_lists(site: Any, default: str, outcome: str):
    class Options(MockMetricDepth.Options):
        weights: str = Field(default, description="a set")

    site.put({"metric_depth": type("Own", (MockMetricDepth,), {"Options": Options})})
    file = site.list_weights("physic-nets", MANIFEST).parent.name
    entries = next(site.folder.glob("physic_mine-*.dist-info")) / "entry_points.txt"
    entries.write_text(f"{entries.read_text()}[physic.weights]\nnets = {file}\n")
    assert result(WEIGHTS).outcome == outcome


OWN = """
from physic_core.interfaces import Packages
from physic_mock.backends import MockMetricDepth

class Own(MockMetricDepth):
    written_for = 1
    def load(self, device="cpu"):
        import pytest
"""


@pytest.mark.parametrize(
    ("stated", "outcome", "got"),
    [((), "warned", "physic_mock, pytest in neither"), (("pytest", "physic_mock"), "passed", "")],
)
def test_a_package_that_nothing_requires_is_caught(
    site: Any, stated: tuple[str, ...], outcome: str, got: str
):
    more = f"    def requirements(self):\n        return (Packages({stated}),)\n"
    site.install(
        "physic-own", OWN + more, entry="own = physic_own:Own", group="physic.metric_depth"
    )
    found = result(PACKAGES)
    assert (found.outcome, found.got) == (outcome, got)
