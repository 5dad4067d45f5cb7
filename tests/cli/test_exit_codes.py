from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from physic_core import errors
from physic_core.cli.exit_codes import EXIT_CODES, MEANINGS, exit_code

pytestmark = pytest.mark.quick


def test_every_error_has_one_code():
    assert set(EXIT_CODES.values()) < set(MEANINGS)
    assert exit_code(ValueError()) == 1


def test_help_lists_every_code(physic):
    shown = physic("--help").output
    assert all(f"  {code:<3}  {meaning}\n" in shown for code, meaning in MEANINGS.items()), shown


@pytest.mark.parametrize("name", errors.__all__)
def test_a_run_ends_with_the_code_of_its_error(name, pipeline, physic):
    pipeline.error = getattr(errors, name)("no good")
    done = physic("run", "photo.jpg", "--preset", "mock", "-q")
    assert (done.exit_code, done.stderr) == (exit_code(pipeline.error), "Error: no good\n")


def test_ctrl_c_ends_every_command_with_130(monkeypatch, physic):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("physic_core.discovery.entry_points._read_entry_points", interrupted)
    for command in (("plugins",), ("config", "check"), ("weights", "list"), ("run", "photo.jpg")):
        monkeypatch.setattr("sys.argv", ["physic", *command])
        done = physic(*command)
        assert done.exit_code == 130
        assert shlex.join(command) in done.stderr


PLUGIN = """
from physic_core.errors import BackendError
from physic_core.interfaces import Inpainter

class Lacking(Inpainter):
    written_for = 1
    def missing(self): return ("weights 'x' are not here",)
    def infer(self, image, mask): return image

class Odd(Inpainter):
    written_for = 1
    def infer(self, image, mask): return image.astype(float)
    def load(self, device="cpu"): raise ValueError("bad magic number")

class Unbuilt(Odd):
    def __init__(self, options=None): raise ValueError("no")

class Newer(Odd):
    written_for = 2
"""
ENTRIES = "\n".join(
    f"{name} = physic_odd:{name.capitalize()}"
    for name in ("lacking", "odd", "unbuilt", "absent", "newer")
)


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("config check --preset mock", 0),
        ("config check --preset mock --set inpainter.backend=odder", 2),
        ("config check --preset mock --set inpainter.backend=lacking", 4),
        # What a user has to bring first is the files.
        ("config check --preset mock --set inpainter.backend=lacking --set run.device=cuda", 4),
        ("config check --preset mock --set inpainter.backend=unbuilt", 5),
        ("plugins doctor newer", 5),
        ("config check --preset mock --set body_model.path=wrong.npz", 3),
        ("run photo.jpg --preset mock --set inpainter.backend=lacking", 4),
        ("plugins", 0),
        ("plugins show odder", 2),
        ("plugins show mock --interface inpaint", 2),
        ("plugins doctor odd", 5),
        ("plugins check lacking", 4),
        ("plugins check odd", 5),
        ("plugins new 'No Name' --interface inpainter", 2),
    ],
)
def test_every_command_ends_with_the_documented_code(command, code, site, monkeypatch, physic):
    monkeypatch.setenv(
        "PHYSIC_PLUGINS",
        "physic-odd,metricbody-testing,metricbody-visual,metricbody-embedded",
    )
    monkeypatch.setattr("physic_core.configuration.resolve.has_gpu", lambda: False)
    site.install("physic-odd", PLUGIN, entry=ENTRIES, group="physic.inpainter")
    Path("wrong.npz").write_text("no body")
    done = physic(*shlex.split(command))
    assert done.exit_code == code, done.output
