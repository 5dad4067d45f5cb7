from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]
PROJECTS = {p.parent.name: p.parent for p in (ROOT / "plugins").glob("*/pyproject.toml")} | {"physic-core": ROOT}


def project(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "pyproject.toml").read_text())["project"]


def requirements(folder: Path) -> list[str]:
    own = project(folder)
    return own["dependencies"] + [r for extra in own.get("optional-dependencies", {}).values() for r in extra]


def wheel_files(folder: Path) -> set[str]:
    """What a wheel of the distribution would hold, without building it."""
    return {f.distribution_path.replace("\\", "/") for f in WheelBuilder(str(folder)).recurse_included_files()}


def pins() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in pairs}


@pytest.mark.parametrize("name", PROJECTS)
def test_a_distribution_is_named_as_its_folder_and_shares_the_version(name: str):
    own = project(PROJECTS[name])
    assert own["name"] == name
    assert own["version"] == project(ROOT)["version"]
    assert own["license"] == "Apache-2.0"
    assert own["requires-python"] == project(ROOT)["requires-python"]


@pytest.mark.parametrize("name", PROJECTS)
def test_a_distribution_sets_lower_bounds_only_and_each_is_pinned_for_the_machine(name: str):
    for requirement in requirements(PROJECTS[name]):
        package, bound = re.fullmatch(r"([a-z0-9-]+)(>=[\w.]+)", requirement, re.I).groups()  # type: ignore[union-attr]
        assert package.startswith("physic-") or package in pins(), f"{requirement} of {name} is not in constraints.txt"
        assert "<" not in bound


def test_torch_is_the_tested_one():
    assert pins()["torch"] == "2.13.0"


@pytest.mark.parametrize("file", ["requirements.txt", "requirements-dev.txt"])
def test_every_plugin_is_installed_by(file: str):
    lines = set((ROOT / file).read_text().splitlines())
    assert {f"-e plugins/{name}" for name in PROJECTS if name != "physic-core"} <= lines
    assert "-c constraints.txt" in lines


@pytest.mark.parametrize("name", [n for n in PROJECTS if n != "physic-core"])
def test_a_plugin_registers_one_module_of_its_own(name: str):
    (module,) = project(PROJECTS[name])["entry-points"]["physic.plugins"].values()
    assert module == name.replace("-", "_")
    assert f"{module}/__init__.py" in wheel_files(PROJECTS[name])


@pytest.mark.parametrize("name", PROJECTS)
def test_a_wheel_holds_its_package_alone(name: str):
    package = name.replace("-", "_")
    files = wheel_files(PROJECTS[name])
    assert {f.partition("/")[0] for f in files} == {package}
    assert f"{package}/py.typed" in files
    assert not [f for f in files if "test_" in f or "__pycache__" in f]


def test_the_core_wheel_holds_presets_and_the_body():
    files = wheel_files(ROOT)
    assert {f"physic_core/presets/{name}.toml" for name in ("embedded", "light-cpu", "mock")} <= files
    assert "physic_core/scaffold/metric_depth.py" in files
    assert any(f.startswith("physic_core/body/") and f.endswith(".npz") for f in files)


def test_the_embedded_wheel_holds_the_networks_and_their_notices():
    files = wheel_files(ROOT / "plugins" / "physic-embedded")
    assert len([f for f in files if f.endswith(".onnx")]) == 9
    assert "physic_embedded/weights/MANIFEST.json" in files
    assert any("notice" in f.lower() or "license" in f.lower() for f in files)
