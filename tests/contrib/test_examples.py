"""The example plugins as their users get them: a wheel in an environment without this repository."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
FROZEN = Path(__file__).parent / "api1" / "physic-example-depth"
"""The example as it was when metric_depth had version 1: it has to work for as long as that is the version."""

EXAMPLES = {
    # The tutorial installs what the example of today holds.
    "depth, frozen": (FROZEN, "metric_depth", "stature"),
    "inpaint": (ROOT / "contrib" / "physic-example-inpaint", "inpainter", "pull-push"),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_wheel_alone_is_listed_and_passes_the_kit_and_a_config_that_selects_it_runs(
    name, environment, build, wheels, tmp_path
):
    folder, interface, backend = EXAMPLES[name]
    environment.install(*wheels.glob("physic_core-*.whl"), *wheels.glob("physic_testing-*.whl"), build(folder))
    listed = json.loads(environment.run("physic plugins --json", tmp_path))
    (only,) = listed["backends"]
    assert (only["interface"], only["backend"], only["status"]) == (interface, backend, "ready")
    assert listed["broken"] == []
    (report,) = json.loads(environment.run(f"physic plugins check {backend} --json", tmp_path))
    assert report["ok"], report
    assert (report["counts"]["failed"], report["counts"]["xfailed"]) == (0, 0)
    assert report["counts"]["passed"] >= 30

    # The other seven interfaces of a run are the mocks'.
    environment.install(*wheels.glob("physic_mock-*.whl"))
    photo(environment, tmp_path)
    (tmp_path / "my.toml").write_text(f'extends = "mock"\n\n[{interface}]\nbackend = "{backend}"\n')
    environment.run("physic run photo.png --config my.toml -o out --no-cache", tmp_path)
    result = json.loads((tmp_path / "out" / "reconstruction.json").read_text())
    asked = {s["provenance"]["interface"]: s["provenance"]["backend"] for s in result["stages"] if s["provenance"]}
    assert asked[interface] == backend
    assert set(asked.values()) == {backend, "mock"}
    assert len(result["people"]) == 1


def photo(environment: Any, folder: Path) -> None:
    """Write a world's photo, which the mocks recognise."""
    script = (
        "from PIL import Image; from physic_testing import build_world; "
        "Image.fromarray(build_world().image).save('photo.png')"
    )
    environment.run(f'python -c "{script}"', folder)


def test_the_frozen_example_stays_as_it_was():
    """Never mend this one: where a core cannot run it, MetricDepth.api has to rise."""
    digest = hashlib.sha256()
    for file in sorted(f for f in FROZEN.rglob("*") if f.is_file() and "__pycache__" not in f.parts):
        digest.update(file.relative_to(FROZEN).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    assert digest.hexdigest() == "1bb9c9ab1ee5a1aefc5207ecca74c03bef68b93d69d90f560e4eb959c2e3fb6a"
