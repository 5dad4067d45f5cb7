"""``physic plugins new``: what it writes passes its own tests as it is."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hatchling.metadata.core import ProjectMetadata
from hatchling.plugin.manager import PluginManager

from physic_core.cli import main
from physic_core.discovery.registry import BackendRecord, Registry
from physic_core.interfaces import INTERFACES
from physic_testing import check_backend
from physic_testing.scaffold.package import PluginNames, plugin_files


def install(package: Path) -> Path:
    """The files that an editable installation leaves, without pip."""
    own = ProjectMetadata(str(package), PluginManager()).core
    (entry, module), *_ = own.entry_points["physic.plugins"].items()
    info = package / f"{own.name.replace('-', '_')}-{own.version or '0.1.0'}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {own.name}\nVersion: {own.version or '0.1.0'}\n")
    (info / "entry_points.txt").write_text(f"[physic.plugins]\n{entry} = {module}\n")
    return package


def new(*arguments: str) -> str:
    done = CliRunner().invoke(main, ["plugins", "new", *arguments])
    assert done.exit_code == 0, done.output
    return done.stdout.splitlines()[-1]


def test_a_new_package_and_one_more_backend_of_it_pass_their_tests(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = new("my-thing", "--interface", "metric_depth")
    assert said == "next: pip install -e physic-my-thing && physic plugins check my-thing"
    said = new("other", "--interface", "inpainter", "--add-to", "physic-my-thing")
    assert said == "next: pip install -e physic-my-thing && physic plugins check other"
    package = install(tmp_path / "physic-my-thing")
    tests = subprocess.run(
        [sys.executable, "-W", "error", "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"],
        cwd=package,
        env=os.environ | {"PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert tests.returncode == 0, tests.stdout + tests.stderr
    assert " passed" in tests.stdout.splitlines()[-1]
    assert "failed" not in tests.stdout.splitlines()[-1]


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_scaffolded_plugin_passes_the_kit(interface: str):
    kind = importlib.import_module(f"physic_testing.scaffold.{interface}").Template
    registry = Registry(installed=False)
    registry.register(BackendRecord(interface, "begun", kind, api=1))
    report = check_backend("begun", interface, registry=registry)
    assert report.ok, report.text


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_scaffold_uses_the_names_that_its_author_gives(interface: str):
    written = plugin_files(PluginNames("my-2nd.thing", interface), "0.1.0", 1)
    assert [p for p in written if "/" not in p] == ["pyproject.toml", "README.md"]
    assert f"physic_my_2nd_thing/{interface}.py" in written
    for path, text in written.items():
        assert "Template" not in text, path
        assert "{" not in text or path.endswith((".py", "README.md")), path
        if path.endswith(".py"):
            compile(text, path, "exec")
    assert f'"physic_my_2nd_thing.{interface}:My2ndThing"' in written["physic_my_2nd_thing/__init__.py"]
    assert '"my-2nd.thing" = "physic_my_2nd_thing"' in written["pyproject.toml"]


def test_a_new_package_is_the_authors_to_build(tmp_path):
    from hatchling.builders.wheel import WheelBuilder

    for path, text in plugin_files(PluginNames("my-thing", "inpainter"), "0.1.0", 1).items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    held = {f.distribution_path for f in WheelBuilder(str(tmp_path)).recurse_included_files()}
    assert held == {f"physic_my_thing/{name}" for name in ("__init__.py", "inpainter.py", "py.typed")}


def test_a_new_package_names_nothing_that_an_index_does_not_have_yet():
    """Whoever registers such a name could run code on the machines of users; the host checks the versions."""
    text = plugin_files(PluginNames("my-thing", "inpainter"), "0.1.0", 1)["pyproject.toml"]
    own = tomllib.loads(text)["project"]
    assert (own["dependencies"], own["optional-dependencies"]) == (
        ["numpy>=2.0", "pydantic>=2.9"],
        {"test": ["pytest>=8.2"]},
    )
    released = tomllib.loads(re.sub(r"(?m)^( *)# (.+)  # once released.*", r"\1\2", text))["project"]
    assert "physic-core>=0.1.0" in released["dependencies"]
    assert "physic-testing>=0.1.0" in released["optional-dependencies"]["test"]


ONE = "BackendRecord('segmenter', 'one', 'own.one:One', api=1)"


@pytest.mark.parametrize(
    "returned",
    [
        f"[{ONE}]",
        f"[{ONE},]",
        "[]",
        f"[\n        {ONE},  # the first\n    ]",
        f"[\n        {ONE}  # é, the first\n    ]",
    ],
)
@pytest.mark.parametrize("above", ["", "src"])
def test_a_backend_is_added_to_what_an_author_wrote(tmp_path, returned: str, above: str):
    package = tmp_path / above / "own"
    package.mkdir(parents=True)
    (tmp_path / "pyproject.toml").write_text('[project.entry-points."physic.plugins"]\nown = "own"\n')
    hooks = package / "__init__.py"
    hooks.write_text(
        "from physic_core import BackendRecord, hookimpl\n\n\n@hookimpl\ndef physic_backends():\n"
        f"    return {returned}\n\n\ndef after():\n    return 'é'\n",
        encoding="utf-8",
    )
    new("second", "--interface", "inpainter", "--add-to", str(tmp_path))
    module: dict[str, Any] = {}
    exec(hooks.read_text(encoding="utf-8"), module)
    assert [record.name for record in module["physic_backends"]()] == [*["one"] * ("one" in returned), "second"]
    assert module["physic_backends"]()[-1].target == "own.inpainter:Second"
    assert module["after"]() == "é"
    assert {file.name for file in package.glob("*.py")} == {"__init__.py", "inpainter.py"}
    new("third", "--interface", "inpainter", "--add-to", str(tmp_path))
    assert {file.name for file in package.glob("*.py")} == {"__init__.py", "inpainter.py", "third.py"}
    assert {file.name for file in (tmp_path / "tests").iterdir()} == {"test_conformance.py", "test_third.py"}


def test_what_is_not_a_plugin_gets_no_backend(tmp_path):
    add = ("plugins", "new", "one", "--interface", "inpainter", "--add-to", str(tmp_path))
    file = tmp_path / "pyproject.toml"
    assert "should be the file of a plugin" in refusal(*add)
    file.write_text('[project.entry-points."physic.plugins"]\nown = "own"\n')
    hooks = tmp_path / "own" / "__init__.py"
    assert f"there is no {hooks}" in refusal(*add)
    hooks.parent.mkdir()
    hooks.write_text("def physic_backends():\n    return RECORDS\n")
    first, record, *_ = refusal(*add).splitlines()
    assert str(hooks) in first
    assert record.strip() == "BackendRecord("
    assert [path.name for path in hooks.parent.iterdir()] == ["__init__.py"]


def refusal(*arguments: str) -> str:
    done = CliRunner().invoke(main, list(arguments))
    assert (done.exit_code, done.stdout) == (2, ""), done.output
    return done.stderr.removeprefix("Error: ").rstrip("\n")


def test_names_that_do_not_serve_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    new = ("plugins", "new")
    assert "Did you mean 'metric_depth'?" in refusal(*new, "my-depth", "--interface", "metric_dept")
    assert "(physic-opencv 0.1.0) is installed already" in refusal(*new, "telea", "--interface", "inpainter")
    assert "a-z, 0-9 and hyphens" in refusal(*new, "My Depth", "--interface", "metric_depth")
    Path("physic-mine").mkdir()
    assert "--add-to physic-mine" in refusal(*new, "mine", "--interface", "inpainter")
