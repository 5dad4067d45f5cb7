from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.quick

LIGHT = """
import sys
from physic_core.cli import main
for arguments in {commands!r}:
    try:
        main(arguments, standalone_mode=True)
    except SystemExit as end:
        assert end.code in {ends!r}, (arguments, end.code)
    heavy = sorted({{m.partition('.')[0] for m in sys.modules}} & {banned!r})
    assert not heavy, (arguments, heavy)
"""
HEAVY = {
    "torch",
    "numpy",
    "scipy",
    "cv2",
    "onnxruntime",
    "PIL",
    "rich",
    "trimesh",
    "roma",
    "kornia",
}
PRESETS = ("best", "embedded", "light-cpu", "mock", "open-body", "paper")


def require_light(commands, banned, ends=(0,)):
    """Run commands in one new process, after each of which no banned module may be imported."""
    code = LIGHT.format(commands=commands, banned=banned, ends=ends)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def test_commands_that_look_around_import_nothing_heavy():
    commands = (
        "--help",
        "--version",
        "plugins",
        "plugins new --help",
        "run --help",
        "batch --help",
        "compare --help",
        "config show",
        "config --help",
        "evaluate --help",
    )
    require_light([command.split() for command in commands], HEAVY)


def test_looking_into_the_cache_imports_nothing_heavy(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path))
    require_light([["cache", "info"]], HEAVY | {"pydantic"})


def test_configs_are_checked_without_torch_and_without_a_runtime():
    # 4: weights are missing here.
    require_light(
        [["config", "check", "--preset", name] for name in PRESETS],
        {"torch", "onnxruntime"},
        (0, 4),
    )


def test_importing_the_package_imports_nothing_heavy():
    code = (
        "import sys, physic_core\n"
        f"print(sorted({{m.partition('.')[0] for m in sys.modules}} & {HEAVY | {'pydantic'}!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "[]"


def test_the_pipeline_is_imported_without_torch_which_is_imported_beside_the_first_network():
    code = (
        "import sys, physic_core.pipeline.run, physic_core.pipeline.estimate; print('torch' in "
        "sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "False"


def test_a_run_of_the_default_preset_does_not_import_the_compiler_of_torch():
    """It takes longer than a second of processor time; roma and torch.optim import it."""
    code = (
        "import sys, torch\n"
        "import physic_core.pipeline.optimise, physic_core.pipeline.checks, "
        "physic_embedded.body_fit.fit\n"
        "print('torch._dynamo' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "False"
