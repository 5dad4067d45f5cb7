"""Each command of the README's "Five uses" ends with a result, or an error that says what to do."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physic_core import load_reconstruction
from physic_core.cli.exit_codes import INPUT, WEIGHTS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
LEFT_OUT = ("serve",)  # it ends with Ctrl-C
CODES = {"scene left.jpg": (0, INPUT), "config check": (WEIGHTS,)}
"""Of commands whose files or packages may not be there: two crops are hardly two views."""


def commands():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```sh\n(.*?)```", text.partition("## Five uses")[2], flags=re.DOTALL)
    lines = (line for block in blocks for line in block.splitlines())
    found = [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("physic ")]
    return [words for words in found if not words or words[0] not in LEFT_OUT]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that the commands name."""
    folder = tmp_path_factory.mktemp("readme")
    with Image.open(ROOT / "examples" / "couple.jpg") as opened:
        photo = opened.convert("RGB")
    photo.save(folder / "photo.jpg")
    (folder / "photos").mkdir()
    shutil.copy(folder / "photo.jpg", folder / "photos")
    photo.save(folder / "left.jpg")
    width, height = photo.size
    photo.crop((width // 20, height // 20, width, height)).save(folder / "right.jpg")
    return folder


@pytest.fixture
def physic_there(folder, physic, monkeypatch):
    """Run a command in the folder, with a cache of its own and a browser that does nothing."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PHYSIC_CACHE", str(folder / "cache"))
    monkeypatch.setenv("PHYSIC__ENGINE__JOINT__OPTIMISER__STEPS", "2")
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    return physic


def test_every_command_ends_with_a_result_or_a_sentence(physic_there, folder):
    for words in commands():
        if "--depth" in words:
            scene = load_reconstruction(folder / "photo-physic").scene
            depth = np.where(scene.valid, 1000 * scene.points[..., 2], 0).clip(max=65535)
            Image.fromarray(depth.astype(np.uint16)).save(folder / "depth.png")
        if "--bodies" in words:
            physic_there("export", "photo-physic", "--to", "bodies", "-o", "people.npz")
        for name in {"out-a", "out-b"}.intersection(words):
            shutil.copytree(folder / "photo-physic", folder / name)
        found = physic_there(*words)
        command = " ".join(words)
        allowed = next((c for start, c in CODES.items() if command.startswith(start)), (0,))
        assert isinstance(found.exception, SystemExit | type(None)), (command, found.exc_info)
        assert found.exit_code in allowed, (command, found.output)
