from __future__ import annotations

import pytest

from physic_core.configuration.layers import preset_names

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


@pytest.fixture
def require_light(python):
    """A function that runs commands in one new process, after each of which no banned module may be
    imported.
    """

    def run(commands, banned, ends=(0,)):
        python(LIGHT.format(commands=commands, banned=banned, ends=ends))

    return run


def test_commands_that_look_around_import_nothing_heavy(require_light):
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


def test_looking_into_the_cache_imports_nothing_heavy(require_light, tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path))
    require_light([["cache", "info"]], HEAVY | {"pydantic"})


def test_configs_are_checked_without_torch_and_without_a_runtime(require_light):
    # 4: weights are missing here.
    require_light(
        [["config", "check", "--preset", name] for name in preset_names()],
        {"torch", "onnxruntime"},
        (0, 4),
    )


@pytest.mark.parametrize(
    ("modules", "banned"),
    [
        ("physic_core", HEAVY | {"pydantic"}),
        # torch is imported beside the first network.
        ("physic_core.pipeline.run, physic_core.pipeline.estimate", {"torch"}),
        # It takes longer than a second of processor time; roma and torch.optim import it.
        (
            "torch, physic_core.pipeline.optimise, physic_core.judge, physic_embedded.body_fit.fit",
            {"torch._dynamo"},
        ),
    ],
    ids=["package", "pipeline", "run of the default preset"],
)
def test_an_import_imports_nothing_heavy(python, modules, banned):
    code = f"import sys, {modules}; print(sorted(set(sys.modules) & {banned!r}))"
    assert python(code).stdout == "[]\n"
