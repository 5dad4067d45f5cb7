"""Classes in files of the user's own: the file that is named is loaded, and nothing that lies
beside it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from physic_core.configuration.model import load_config
from physic_core.configuration.resolve import resolve
from physic_core.discovery.local_modules import load_module
from physic_core.errors import BackendError, ConfigError

DEPTH = """
from physic_core.interfaces import MetricDepth

class MyDepth(MetricDepth):
    def infer(self, image, hints): ...
"""


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    # "" is the current folder
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if folder])
    path = list(sys.path)
    modules = set(sys.modules)
    yield
    assert sys.path == path
    for name in [
        name for name in sys.modules if name.partition(".")[0] in NAMES and name not in modules
    ]:
        del sys.modules[name]


NAMES = ("own_depth", "own_package", "own_helper", "own_part")


def config(folder, backend):
    folder.mkdir(exist_ok=True)
    path = folder / "my.toml"
    path.write_text(f'extends = "mock"\n[metric_depth]\nbackend = "{backend}"\n')
    return path


def kind(file=None, *overrides):
    plan = resolve(load_config(file, preset=None if file else "mock", overrides=overrides))
    return type(plan.backends["metric_depth"].backend)


# ---- where it is looked up
# -------------------------------------------------------------------------------------------


def test_the_class_of_a_config_lies_beside_the_config(tmp_path):
    file = config(tmp_path / "elsewhere", "own_depth:MyDepth")
    (tmp_path / "elsewhere" / "own_depth.py").write_text(DEPTH)
    Path("own_depth.py").write_text("raise SystemExit('of the current folder')")
    assert kind(file).__module__ == "own_depth"
    assert sys.modules["own_depth"].__file__ == str(tmp_path / "elsewhere" / "own_depth.py")


def test_the_class_of_a_variable_lies_on_pythons_path_alone(monkeypatch):
    Path("own_depth.py").write_text(DEPTH)
    monkeypatch.setenv("PHYSIC__METRIC_DEPTH__BACKEND", "own_depth:MyDepth")
    with pytest.raises(ConfigError, match=r"No module named .own_depth."):
        kind()


def test_the_resolved_config_holds_from_anywhere(tmp_path, monkeypatch):
    Path("own_depth.py").write_text(DEPTH)
    tables = load_config(
        preset="mock", overrides=["metric_depth.backend=own_depth:MyDepth"]
    ).as_dict()
    (tmp_path / "out").mkdir()
    result = tmp_path / "out" / "reconstruction.json"
    result.write_text(json.dumps({"config": tables}))
    monkeypatch.chdir(tmp_path)
    plan = resolve(load_config(result))
    assert plan.backends["metric_depth"].provenance.backend == "own_depth:MyDepth"


@pytest.mark.parametrize(
    "command",
    [
        ("config", "check", "--preset", "mock", "--set", "metric_depth.backend=own_depth:MyDepth"),
        ("plugins", "show", "own_depth:MyDepth", "--interface", "metric_depth"),
        ("plugins", "doctor", "own_depth:MyDepth"),
    ],
    ids=lambda command: command[1],
)
def test_commands_know_the_class_of_a_file_in_the_current_folder(command, physic):
    Path("own_depth.py").write_text(DEPTH)
    done = physic(*command)
    assert done.exit_code == 0, done.output
    assert "BROKEN" not in done.output


# ---- what it may be
# --------------------------------------------------------------------------------------------------


def test_what_lies_beside_the_module_is_not_found(tmp_path):
    file = config(tmp_path / "elsewhere", "own_depth:MyDepth")
    folder = file.parent
    (folder / "own_helper.py").write_text("raise SystemExit('imported')")
    (folder / "own_depth.py").write_text("import own_helper\n" + DEPTH)
    with pytest.raises(BackendError) as caught:
        kind(file)
    assert "No module named 'own_helper' (own_depth.py:1); beside a config, only the module" in str(
        caught.value
    )
    assert "own_depth" not in sys.modules


@pytest.mark.parametrize(
    ("name", "whose"), [("colorsys", "colorsys.py"), ("click", "click/__init__.py")]
)
def test_the_name_of_an_installed_module_is_refused(tmp_path, name, whose):
    (tmp_path / f"{name}.py").write_text(DEPTH)
    with pytest.raises(ImportError) as caught:
        load_module(tmp_path, name)
    assert str(caught.value).startswith(f"another module is called {name} (")
    assert str(caught.value).endswith(f"{whose}): rename {tmp_path / name}.py")
    with pytest.raises(BackendError, match=f"another module is called {name} "):
        resolve(
            load_config(
                preset="mock", overrides=[f"metric_depth.backend={tmp_path}/{name}:MyDepth"]
            )
        )


def test_two_files_of_one_name_are_refused(tmp_path):
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        (folder / "own_depth.py").write_text(DEPTH)
    first = load_module(tmp_path / "a", "own_depth")
    with pytest.raises(ImportError, match="another module is called own_depth "):
        load_module(tmp_path / "b", "own_depth")
    assert load_module(tmp_path / "a", "own_depth") is first
