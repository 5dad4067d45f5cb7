from __future__ import annotations

import subprocess
import sys

import pytest

LIGHT = """
import sys
from physic_core.cli import main
try:
    main({arguments!r}, standalone_mode=True)
except SystemExit as end:
    assert end.code in {ends!r}, end.code
heavy = {{m.partition('.')[0] for m in sys.modules}} & {banned!r}
print("heavy:", sorted(heavy))
"""
HEAVY = {"torch", "numpy", "scipy", "cv2", "onnxruntime", "PIL", "rich", "trimesh", "roma", "kornia"}


def imports(arguments: list[str], banned: set[str], ends: tuple[int, ...] = (0,)) -> str:
    code = LIGHT.format(arguments=arguments, banned=banned, ends=ends)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        ["plugins"],
        ["plugins", "new", "--help"],
        ["run", "--help"],
        ["batch", "--help"],
        ["compare", "--help"],
        ["config", "show"],
        ["config", "--help"],
        ["bench", "accuracy", "--help"],
    ],
    ids=" ".join,
)
def test_a_command_that_looks_around_imports_nothing_heavy(arguments: list[str]):
    assert imports(arguments, HEAVY) == "heavy: []"


@pytest.mark.parametrize("preset", ["best", "embedded", "light-cpu", "mock", "open-body", "paper"])
def test_a_config_is_checked_without_torch_and_without_a_runtime(preset: str):
    # 4: weights are missing here.
    assert imports(["config", "check", "--preset", preset], {"torch", "onnxruntime"}, (0, 4)) == "heavy: []"


def test_importing_the_package_imports_nothing_heavy():
    code = (
        "import sys, physic_core\n"
        f"print(sorted({{m.partition('.')[0] for m in sys.modules}} & {HEAVY | {'pydantic'}!r}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.strip() == "[]"


def test_a_run_of_the_default_preset_does_not_import_the_compiler_of_torch():
    """It takes longer than a second of processor time; roma and torch.optim import it."""
    code = (
        "import sys, torch\n"
        "import physic_core.pipeline.optimise, physic_core.pipeline.checks, physic_embedded.body_fit.fit\n"
        "print('torch._dynamo' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.strip() == "False"
