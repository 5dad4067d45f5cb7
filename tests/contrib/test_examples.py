"""The example plugins as their users get them: a wheel in an environment without this repository."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from physic_core.interfaces import INTERFACES

ROOT = Path(__file__).parents[2]


def test_the_wheel_of_the_example_is_listed_passes_the_kit_and_runs(environment, build, wheels, tmp_path):
    """That of the inpainter; the tutorial installs what the other example holds."""
    folder, interface, backend = ROOT / "contrib" / "physic-example-inpaint", "inpainter", "pull-push"
    environment.install(*wheels.glob("physic_core-*.whl"), *wheels.glob("physic_testing-*.whl"), build(folder))
    _, *rows = environment.run("physic plugins", tmp_path).splitlines()
    assert [row.split()[:2] for row in rows if row.startswith(tuple(INTERFACES))] == [[interface, backend]]
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
