"""The example plugins as their users get them: a wheel in an environment without this
repository.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from physic_core.interfaces import INTERFACES

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_wheel_of_the_example_is_listed_and_passes_the_kit(
    environment, build, wheels, tmp_path
):
    """That of the inpainter; the tutorial installs and runs what the other example holds."""
    folder = ROOT / "contrib" / "example-inpaint"
    interface = "inpainter"
    backend = "pull-push"
    environment.install(
        *wheels.glob("metricbody-*.whl"), *wheels.glob("metricbody_testing-*.whl"), build(folder)
    )
    _, *rows = environment.run("physic plugins", tmp_path).splitlines()
    assert [interface, backend] in [
        row.split()[:2] for row in rows if row.startswith(tuple(INTERFACES))
    ]
    (report,) = json.loads(environment.run(f"physic plugins check {backend} --json", tmp_path))
    assert report["ok"], report
    assert report["counts"]["failed"] == 0
    assert report["counts"]["passed"] >= 18
