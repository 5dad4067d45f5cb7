"""``physic plugins new``: what it writes passes the kit as it is."""

from __future__ import annotations

import importlib
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from physic_core.cli import main
from physic_core.interfaces import INTERFACES
from physic_testing import check_backend
from physic_testing.scaffold.package import PluginNames, plugin_files


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_scaffolded_backend_passes_the_kit(interface):
    kind = importlib.import_module(f"physic_testing.scaffold.{interface}").Template
    assert kind.written_for == INTERFACES[interface].api
    report = check_backend(kind, size=(160, 120))
    assert report.ok, report.text
    assert not report.counts["warned"], report.text


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_scaffold_uses_the_names_that_its_author_gives(interface):
    written = plugin_files(PluginNames("my-2nd.thing", interface), "0.1.0")
    assert list(written) == [
        "pyproject.toml",
        "physic_my_2nd_thing.py",
        "tests/test_conformance.py",
    ]
    for path, text in written.items():
        assert "Template" not in text, path
        assert "{" not in text or path.endswith(".py"), path
        if path.endswith(".py"):
            compile(text, path, "exec")
    entries = tomllib.loads(written["pyproject.toml"])["project"]["entry-points"]
    assert entries == {f"physic.{interface}": {"my-2nd.thing": "physic_my_2nd_thing:My2ndThing"}}


def test_two_files_are_a_plugin(tmp_path):
    from hatchling.builders.wheel import WheelBuilder

    files = plugin_files(PluginNames("my-thing", "inpainter"), "0.1.0")
    for path in ("pyproject.toml", "physic_my_thing.py"):
        (tmp_path / path).write_text(files[path])
    contents = {f.distribution_path for f in WheelBuilder(str(tmp_path)).recurse_included_files()}
    assert contents == {"physic_my_thing.py"}


def test_a_new_package_requires_the_core_and_tests_itself_with_the_kit():
    text = plugin_files(PluginNames("my-thing", "inpainter"), "0.1.0")["pyproject.toml"]
    project = tomllib.loads(text)["project"]
    assert project["dependencies"] == ["numpy>=2.0", "metricbody>=0.1.0", "pydantic>=2.9"]
    assert project["optional-dependencies"] == {
        "test": ["metricbody-testing>=0.1.0", "pytest>=8.2"]
    }


@pytest.mark.parametrize(
    ("name", "interface", "says"),
    [
        ("my-depth", "metric_dept", "Did you mean 'metric_depth'?"),
        ("telea", "inpainter", "(metricbody-embedded 0.1.0) is installed already"),
        ("My Depth", "metric_depth", "a-z, 0-9 and hyphens"),
        ("mine", "inpainter", "physic-mine exists already"),
    ],
)
def test_names_that_do_not_serve_are_refused(name, interface, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("physic-mine").mkdir()
    done = CliRunner().invoke(main, ["plugins", "new", name, "--interface", interface])
    assert (done.exit_code, done.stdout) == (2, ""), done.output
    assert says in done.stderr
