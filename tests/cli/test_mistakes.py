"""What users and authors are told about their mistakes, whole: mistakes.txt holds every message."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from physic_core.cli import main

PAGE = Path(__file__).with_name("mistakes.txt")

CONFIGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "a key is misspelt": ("[photo]\nmax_sid = 800\n", ()),
    "a table is misspelt": ('[inpaintr]\nbackend = "telea"\n', ()),
    "no backend of this name": ('[inpainter]\nbackend = "telae"\n', ()),
    "a backend of another interface": ('[inpainter]\nbackend = "grabcut"\n', ()),
    "an option is misspelt, another out of bounds": (
        '[inpainter]\nbackend = "telea"\noptions = { radius = 3.0, max_hole_px = 3 }\n',
        (),
    ),
    "an option of the wrong kind": ('[inpainter]\nbackend = "telea"\noptions = { radius_px = "wide" }\n', ()),
    "an interface that a run needs is left out": ('[segmenter]\nbackend = "none"\n', ()),
    "two cameras": ("[photo]\nfocal_px = 900\nintrinsics = [900, 900, 320, 240]\n", ()),
    "a preset that is not there": ('extends = "light"\n', ()),
    "no TOML": ("[photo\nmax_side = 800\n", ()),
    "a class that is nowhere": ('[metric_depth]\nbackend = "my_depth:MyDepth"\n', ()),
    "no file of that name": ('[body_model]\npath = "SMPLX_NEUTRAL.npz"\n', ()),
    "a setting of the engine": ('[engine]\npreset = "papr"\n', ()),
    "an override without a value": ("", ("--set", "inpainter.backend")),
    "everything at once": (
        'extends = "embedded"\n[photo]\nmax_side = "big"\n[inpaintr]\nbackend = "telea"\n'
        '[relative_pointmap.options]\nshort_sid = 322\n[engine.scene]\nfloor = "flat"\n',
        ("--set", "contact_prior.backend=embeded"),
    ),
}

HOOK = "from physic_core import BackendRecord, hookimpl\n\n@hookimpl\ndef physic_backends():\n    return "
CLASS = (
    "\nfrom physic_core import interfaces\n\nclass Mine(interfaces.Inpainter):\n"
    "    def infer(self, image, mask): return image\n"
)
RECORD = '[BackendRecord("inpainter", "mine", "physic_mine:Mine", api=1)]\n'
PLUGINS: dict[str, tuple[str, tuple[str, ...]]] = {
    "an import that fails": ("import no_such_module\n", ("plugins",)),
    "the hook is misspelt": (HOOK.replace("_backends", "_backend") + RECORD, ("plugins",)),
    "the decorator is forgotten": (HOOK.replace("@hookimpl\n", "") + RECORD, ("plugins",)),
    "one record in place of a list": (HOOK + RECORD.strip("[]\n") + "\n", ("plugins",)),
    "no such interface": (HOOK + RECORD.replace("inpainter", "inpaint"), ("plugins",)),
    "a target without a class": (HOOK + RECORD.replace(":Mine", ".Mine"), ("plugins",)),
    "a name that no config can say": (HOOK + RECORD.replace('"mine"', '"My Fill"'), ("plugins",)),
    "a newer version of the interface": (HOOK + RECORD.replace("api=1", "api=2"), ("plugins",)),
    "Python is left": ("import sys\nsys.exit('no licence found')\n", ("plugins",)),
    "a name that somebody else has": (HOOK + RECORD.replace('"mine"', '"telea"'), ("plugins",)),
    "the class is not there": (HOOK + RECORD, ("plugins", "show", "mine")),
    "a class of another interface": (
        HOOK + RECORD + CLASS.replace("Inpainter", "Segmenter"),
        ("config", "check", "--set", "inpainter.backend=mine"),
    ),
    "a class without its method": (
        HOOK + RECORD + CLASS.replace("infer", "inpaint"),
        ("plugins", "doctor", "mine"),
    ),
    "weights that are not there": (
        HOOK + RECORD + CLASS + "    def load(self, device='cpu'):\n"
        "        raise FileNotFoundError(2, 'No such file or directory', 'mine.onnx')\n",
        ("plugins", "doctor", "mine"),
    ),
    "weights that are not there, well said": (
        HOOK + RECORD + CLASS + "    def load(self, device='cpu'):\n"
        "        from physic_core.errors import BackendError\n"
        "        raise BackendError('no file mine.onnx: get it from its author, and set options.weights')\n",
        ("plugins", "doctor", "mine"),
    ),
}


def told(arguments: tuple[str, ...]) -> str:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    text = done.output.replace(sys.executable, "/path/to/python")
    text = re.sub(r"installed: [^.\n]*", "installed: ...", text)  # whatever else this Python has
    return f"$ physic {' '.join(arguments)}\n{text.rstrip()}\nexit code {done.exit_code}\n"


def of_config(name: str) -> str:
    text, further = CONFIGS[name]
    Path("my.toml").write_text(text)
    return f"{text}\n{told(('config', 'check', 'my.toml', *further))}"


def of_plugin(name: str, site: Any, monkeypatch: pytest.MonkeyPatch) -> str:
    source, arguments = PLUGINS[name]
    site.install("physic-mine", source)
    if "config" not in arguments:  # else the table of the others, too, would be here
        monkeypatch.setenv("PHYSIC_PLUGINS", f"physic-mine,physic-testing{',physic-opencv' * ('else has' in name)}")
    return f"{source}\n{told(arguments)}"


def held(name: str) -> str:
    """The part of the page under a heading."""
    _, found, rest = PAGE.read_text().partition(f"======== {name} ========\n")
    assert found, f"{name} is not in {PAGE.name}"
    return rest.partition("\n========")[0].rstrip("\n") + "\n"


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))


@pytest.mark.parametrize("name", CONFIGS)
def test_a_mistake_in_a_config_gives_its_message(name: str):
    assert of_config(name) == held(name)


@pytest.mark.parametrize("name", PLUGINS)
def test_a_mistake_in_a_plugin_gives_its_message(name: str, site: Any, monkeypatch: pytest.MonkeyPatch):
    assert of_plugin(name, site, monkeypatch) == held(name)


def test_the_page_holds_these_and_no_others():
    names = [line.strip("= ") for line in PAGE.read_text().splitlines() if line.startswith("========")]
    assert names == [*CONFIGS, *PLUGINS]
