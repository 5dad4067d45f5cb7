"""What a record says of its weights and packages, against their manifest and what is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from physic_core.discovery.offers import Manifest, Origin
from physic_core.discovery.registry import BackendRecord, Registry
from physic_mock.backends import MockMetricDepth
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks
from physic_testing.conformance.report import Result

MANIFEST = """
[research]
summary = "a network"
license = "CC-BY-NC-4.0"
commercial = false
[[research.files]]
path = "a.onnx"
source = "https://example.org/a.onnx"

[free]
summary = "a network"
license = "Apache-2.0"
commercial = true
[[free.files]]
path = "b.onnx"
source = "https://example.org/b.onnx"
"""

LICENCE, SETS = "record_states_the_licence_of_the_weights", "record_names_weights_that_exist"
PACKAGES = "record_names_packages_that_it_uses"


def result(check: str, folder: Path, **record: Any) -> Result:
    """Return the result of a check for a backend with this record and the manifest above."""
    origin = Origin("physic-own", "1.0")
    (folder / "weights.toml").write_text(MANIFEST)
    registry = Registry(manifests=[Manifest(origin, folder / "weights.toml")], installed=False)
    registry.register(BackendRecord("metric_depth", "own", MockMetricDepth, api=1, **record), origin)
    return start_checks(find_backend("own", "metric_depth", registry)).result(check)


@pytest.mark.parametrize(
    ("check", "record", "words"),
    [
        (SETS, {"weights": ("fre",), "weights_license": "Apache-2.0"}, "none of this name: fre"),
        (LICENCE, {"weights": ("research",), "weights_license": "MIT (A Network)"}, "'MIT (A Network)'"),
        (LICENCE, {"weights": ("free",), "weights_license": "MIT (A Network)"}, "'MIT (A Network)'"),
        (LICENCE, {"weights": ("free",)}, "an empty weights_license"),
        (PACKAGES, {"packages": ("no_such_package",)}, "no package no_such_package"),
        (PACKAGES, {"packages": ("turtledemo",)}, "turtledemo is not imported after calls"),
    ],
)
def test_a_record_that_says_something_else_is_caught(check: str, record: dict[str, Any], words: str, tmp_path: Path):
    found = result(check, tmp_path, **record)
    assert found.outcome in ("failed", "warned")
    assert words in found.got


def test_a_package_that_neither_record_nor_distribution_lists_is_caught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "own_depth.py").write_text(
        "from physic_mock.backends import MockMetricDepth\n\n\nclass Own(MockMetricDepth):\n"
        "    def load(self, device='cpu'):\n        import pytest\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    origin = Origin("physic-own", "1.0")
    registry = Registry(installed=False)
    for name, packages in (("silent", ()), ("open", ("pytest", "physic_mock"))):
        record = BackendRecord("metric_depth", name, "own_depth:Own", api=1, packages=packages)
        registry.register(record, origin)
    silent, open_ = (
        start_checks(find_backend(name, "metric_depth", registry)).result(PACKAGES) for name in ("silent", "open")
    )
    assert (silent.outcome, silent.got) == ("warned", "physic_mock, pytest in neither")
    assert open_.outcome == "passed"


@pytest.mark.parametrize(
    ("check", "record"),
    [
        (SETS, {"weights": ("free",), "weights_license": "Apache-2.0"}),
        (LICENCE, {"weights": ("free",), "weights_license": "Apache-2.0 (A Network)"}),
        (LICENCE, {"weights": ("research",), "weights_license": "CC-BY-NC-4.0: non-commercial"}),
        (PACKAGES, {"packages": ("numpy",)}),
    ],
)
def test_a_true_record_passes(check: str, record: dict[str, Any], tmp_path: Path):
    assert result(check, tmp_path, **record).outcome == "passed"
